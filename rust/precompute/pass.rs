//! A pass makes rows of M, a bundle of neighbouring ones at a time; this is what all passes share: tiles, and the survey
//! that comes before them.
//!
//! A pass is a function of (scene, settings, rows): any split over threads, machines or interrupted runs gives the same M.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;

use crate::basis::Bands;
use crate::error::{Error, Result};
use crate::transport::entry::Channels;
use crate::transport::lobes::Lobes;
use crate::transport::sight::{Encoded, Seen, Sight};
use crate::transport::{
    CompressedGroup, GROUP, MAX_TILE_ROWS, Measure, Rows16, Survey, Tile, Truncation, Width, compress_group,
};

/// Rows that a pass makes together.
pub const BUNDLE_ROWS: usize = 64;

/// Groups of 16 rows that a transport keeps untruncated: 512 rows, more than the 299 that bound the 99th percentile of the
/// error with 95 % confidence (0.99^299 = 0.0495).
const AUDIT_GROUPS: usize = 32;

/// At most one group in this many is kept: untruncated rows are some twenty times as long as the others.
const AUDIT_SHARE: usize = 64;

/// Rays that a pass has shot: what its time is measured against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rays {
    /// To texel centres.
    pub first: u64,
    /// Of those, what met no surface.
    pub open: u64,
    /// Into texels that an edge runs through.
    pub edge: u64,
}

impl Rays {
    /// The sum of both.
    pub fn plus(self, other: Rays) -> Rays {
        Rays { first: self.first + other.first, open: self.open + other.open, edge: self.edge + other.edge }
    }
}

/// What a pass makes: `factors` matrices of `rows` x `bands.columns()`, each of so many channels.
#[derive(Clone)]
pub struct Shape {
    /// Receivers, over all tiles.
    pub rows: usize,
    /// Texels along a face, where some columns are texels (of the first factor).
    pub texels: Option<usize>,
    /// The lobes that those have for cosines, where any row is glossy.
    pub lobes: Option<Lobes>,
    /// How the columns group; the same for all factors.
    pub bands: Bands,
    /// One number for all colours, or one each.
    pub channels: Channels,
    /// Matrices made together; `Take` counts them from 0.
    pub factors: usize,
}

/// Takes 16 finished rows of a factor: `(factor, planes, beside)`, columns x 16 for each channel, and the norm of the longest
/// of the rows in texel columns. Groups of a factor come in order.
pub type Take<'a> = dyn FnMut(usize, &[&[Rows16]], f64) -> Result<()> + 'a;

/// Hears of every bundle's rows, and may stop the pass.
pub type Advance<'a> = dyn Fn(u64) -> Result<()> + Sync + 'a;

/// What a bundle has taken and found, besides its rows.
pub struct Made {
    /// Shot for it.
    pub rays: Rays,
    /// What its rows see of the texels, where some columns are texels.
    pub seen: Option<Seen>,
}

/// One deterministic piece of precomputation.
pub trait Pass: Sync {
    /// Room for one bundle, kept by each thread.
    type Room: Send;

    /// The size of what is made; it never changes.
    fn shape(&self) -> &Shape;

    /// Fresh room, of which each thread asks for one or more.
    fn room(&self) -> Self::Room;

    /// Makes the rows of one bundle (at most `BUNDLE_ROWS`) and hands over group after group.
    fn bundle(&self, rows: Range<usize>, room: &mut Self::Room, take: &mut Take) -> Result<Made>;
}

/// The tiles of some rows, one a factor, each truncated by its rule.
pub fn tile<P: Pass>(
    pass: &P,
    rows: Range<usize>,
    rules: &[Truncation],
    advance: &Advance,
) -> Result<(Vec<Tile>, Rays)> {
    let Shape { rows: all, texels, lobes, bands, channels, factors } = pass.shape();
    if rows.is_empty() || rows.end > *all || rows.len() > MAX_TILE_ROWS || rules.len() != *factors {
        let (first, count) = (rows.start, rows.len());
        return Err(Error::input(format!(
            "expected a tile of at most {MAX_TILE_ROWS} rows inside {all}, and {factors} rules, got {count} rows from \
             {first} and {} rules",
            rules.len()
        )));
    }
    let bundles: Vec<Bundle> = rows
        .clone()
        .into_par_iter()
        .step_by(BUNDLE_ROWS)
        .map_init(
            || pass.room(),
            |room, start| {
                let own = start..(start + BUNDLE_ROWS).min(rows.end);
                let mut groups = vec![Vec::new(); *factors];
                let Made { rays, seen } = pass.bundle(own.clone(), room, &mut |factor, planes, beside| {
                    let mut out = CompressedGroup::default();
                    compress_group(planes, bands, &rules[factor], beside, &mut out)?;
                    groups[factor].push(out);
                    Ok(())
                })?;
                let shifts = || groups[0].iter().map(|group| group.least).collect();
                let encode = |(seen, size): (Seen, usize)| Encoded::new(&seen, size, rules[0].quantum, shifts());
                let sight = seen.zip(*texels).map(encode);
                if let Some(sight) = &sight {
                    add_norms(&mut groups[0], sight, bands);
                }
                advance(own.len() as u64)?;
                Ok(Bundle { groups, sight, rays })
            },
        )
        .collect::<Result<_>>()?;

    let mut rays = Rays::default();
    let mut groups = vec![Vec::new(); *factors];
    let mut sights = Vec::new();
    for bundle in bundles {
        rays = rays.plus(bundle.rays);
        groups.iter_mut().zip(bundle.groups).for_each(|(all, own)| all.extend(own));
        sights.extend(bundle.sight);
    }
    let assemble = |(groups, rule): (&Vec<CompressedGroup>, &Truncation)| {
        Tile::assemble(rows.len(), bands.stored(), *channels, (rule.width, rule.quantum), groups)
    };
    let mut tiles: Vec<Tile> = groups.iter().zip(rules).map(assemble).collect();
    let lobes = || lobes.as_ref().map(|lobes| lobes.part(rows.clone()));
    tiles[0].sight = texels.map(|size| Sight::join(size, rules[0].quantum, lobes(), &sights));
    Ok((tiles, rays))
}

/// A finished bundle of a tile.
struct Bundle {
    groups: Vec<Vec<CompressedGroup>>,
    sight: Option<Encoded>,
    rays: Rays,
}

/// Writes the norms of texel columns, which are the last band, into the groups of a bundle.
fn add_norms(groups: &mut [CompressedGroup], sight: &Encoded, bands: &Bands) {
    for (row, [kept, dropped]) in sight.norms().enumerate() {
        let place = (row % GROUP) * bands.count() + bands.count() - 1;
        groups[row / GROUP].kept[place] = kept;
        groups[row / GROUP].dropped[place] = dropped;
    }
}

/// What a survey has seen of one factor.
pub struct Surveyed {
    /// How large entries are, from which a threshold follows.
    pub survey: Survey,
    /// Numbers, over all rows, of groups that are kept untruncated to measure truncation against.
    pub groups: Vec<u32>,
    /// Those groups one below the other, in 16 bits with threshold 0.
    pub audit: Tile,
    /// Bytes that the texel columns of a bundle take, in the mean.
    pub texel_bytes: f64,
}

/// What one bundle of a survey has shown.
struct Looked {
    surveys: Vec<Survey>,
    /// The first group of each factor, untruncated, and its number.
    first: Vec<Option<CompressedGroup>>,
    group: usize,
    seen: Option<Seen>,
    texel_bytes: usize,
    rays: Rays,
}

/// The k-th of `count` bundles that lie evenly spread over all rows.
pub(super) fn spread<P: Pass>(pass: &P, k: usize, count: usize) -> Range<usize> {
    let total = pass.shape().rows;
    let start = (2 * k + 1) * total.div_ceil(BUNDLE_ROWS) / (2 * count) * BUNDLE_ROWS;
    start..(start + BUNDLE_ROWS).min(total)
}

/// Looks at evenly spread bundles before the pass, for each factor under its rule (the threshold aside), and measures
/// truncation under the lights, if there are any; and the rays that it took. What it finds depends on nothing but the scene.
pub fn survey<P: Pass>(
    pass: &P,
    bundles: usize,
    rules: &[Truncation],
    lights: &Arc<Vec<Measure>>,
    advance: &Advance,
) -> Result<(Vec<Surveyed>, Rays)> {
    let Shape { rows: total, texels, lobes, bands, channels, factors } = pass.shape();
    let count = bundles.min(total.div_ceil(BUNDLE_ROWS));
    let lossless = rules.iter().map(|rule| rule.lossless(Width::I16)).collect::<Result<Vec<_>>>()?;
    let new = |rule| Survey::new(bands, rule, Arc::clone(lights));
    let empty: Vec<Survey> = rules.iter().map(new).collect::<Result<_>>()?;
    let looked: Vec<Looked> = (0..count)
        .into_par_iter()
        .map_init(
            || pass.room(),
            |room, k| {
                let rows = spread(pass, k, count);
                let (mut surveys, mut first) = (empty.clone(), vec![None; *factors]);
                let Made { rays, seen } = pass.bundle(rows.clone(), room, &mut |factor, planes, beside| {
                    surveys[factor].add(planes)?;
                    if first[factor].is_none() {
                        let mut group = CompressedGroup::default();
                        compress_group(planes, bands, &lossless[factor], beside, &mut group)?;
                        first[factor] = Some(group);
                    }
                    Ok(())
                })?;
                advance(rows.len() as u64)?;
                let shifts = vec![0; rows.len().div_ceil(GROUP)];
                let encode = |(seen, size): (&Seen, usize)| Encoded::new(seen, size, rules[0].quantum, shifts);
                let texel_bytes = seen.as_ref().zip(*texels).map(encode).map_or(0, |encoded| encoded.nbytes());
                Ok(Looked { surveys, first, group: rows.start / GROUP, seen, texel_bytes, rays })
            },
        )
        .collect::<Result<_>>()?;

    let wanted = AUDIT_GROUPS.min(total / (GROUP * AUDIT_SHARE));
    // A last group that is not full cannot stand among whole ones.
    let kept: Vec<usize> = (0..looked.len())
        .filter(|k| (k + 1) * wanted / looked.len() > k * wanted / looked.len())
        .filter(|&k| (looked[k].group + 1) * GROUP <= *total)
        .collect();
    let of_factor = |(factor, mut survey): (usize, Survey)| {
        looked.iter().for_each(|bundle| survey.merge(&bundle.surveys[factor]));
        let mut audited: Vec<CompressedGroup> = kept.iter().filter_map(|&k| looked[k].first[factor].clone()).collect();
        let sights = match texels {
            Some(size) if factor == 0 => sights_of(&looked, &kept, &audited, *size, rules[0].quantum),
            _ => Vec::new(),
        };
        audited.chunks_mut(BUNDLE_ROWS / GROUP).zip(&sights).for_each(|(own, sight)| add_norms(own, sight, bands));
        let mut audit =
            Tile::assemble(audited.len() * GROUP, bands.stored(), *channels, (Width::I16, rules[0].quantum), &audited);
        let rows = kept.iter().flat_map(|&k| (looked[k].group * GROUP..).take(GROUP));
        let lobes = || lobes.as_ref().map(|lobes| lobes.picked(rows.clone()));
        audit.sight = texels.filter(|_| factor == 0).map(|size| Sight::join(size, rules[0].quantum, lobes(), &sights));
        let groups = kept.iter().map(|&k| looked[k].group as u32).collect();
        let texel_bytes = looked.iter().map(|own| own.texel_bytes as f64).sum::<f64>() / looked.len().max(1) as f64;
        Surveyed { survey, groups, audit, texel_bytes }
    };
    let rays = looked.iter().fold(Rays::default(), |sum, bundle| sum.plus(bundle.rays));
    Ok((empty.into_iter().enumerate().map(of_factor).collect(), rays))
}

/// What the first groups of the bundles `kept` see, four groups a bundle, in the units of `groups`.
fn sights_of(looked: &[Looked], kept: &[usize], groups: &[CompressedGroup], size: usize, quantum: i32) -> Vec<Encoded> {
    const EACH: usize = BUNDLE_ROWS / GROUP;
    let bundle = |(four, groups): (&[usize], &[CompressedGroup])| {
        let mut seen = Seen { normals: Vec::new(), open: vec![0; 6 * size * size], means: Vec::new() };
        for (place, own) in four.iter().filter_map(|&k| looked[k].seen.as_ref()).enumerate() {
            seen.normals.extend(&own.normals[..GROUP]);
            let first = own.means.iter().filter(|(row, _)| *row < GROUP);
            seen.means.extend(first.map(|(row, means)| (place * GROUP + row, means.clone())));
            for (open, own) in seen.open.iter_mut().zip(&own.open) {
                *open |= (own & 0xffff) << (place * GROUP);
            }
        }
        Encoded::new(&seen, size, quantum, groups.iter().map(|group| group.least).collect())
    };
    kept.chunks(EACH).zip(groups.chunks(EACH)).map(bundle).collect()
}

/// What a probe has found.
#[derive(Clone, Copy, Debug, Default)]
pub struct Probed {
    /// Bundles made, of at most `BUNDLE_ROWS` rows each.
    pub bundles: usize,
    /// On all threads.
    pub seconds: f64,
    /// Rays that they shot.
    pub rays: Rays,
}

/// Makes evenly spread bundles, as the pass itself would, for about so many seconds: what time and bytes to expect of all
/// of them. Rounds of bundles double until the time is up.
pub fn probe<P: Pass>(pass: &P, seconds: f64, rules: &[Truncation], advance: &Advance) -> Result<Probed> {
    let all = pass.shape().rows.div_ceil(BUNDLE_ROWS);
    let mut count = rayon::current_num_threads().max(1);
    let mut found = Probed::default();
    let threads = count as f64;
    let started = Instant::now();
    while started.elapsed().as_secs_f64() < seconds && found.bundles < all {
        let round = (0..count.min(all)).into_par_iter().map_init(
            || pass.room(),
            |room, k| {
                let started = Instant::now();
                let rows = spread(pass, k, count.min(all));
                let mut group = CompressedGroup::default();
                let Made { rays, .. } = pass.bundle(rows, room, &mut |factor, planes, beside| {
                    compress_group(planes, &pass.shape().bands, &rules[factor], beside, &mut group)
                })?;
                advance(0)?;
                Ok((rays, started.elapsed().as_secs_f64()))
            },
        );
        let round: Vec<(Rays, f64)> = round.collect::<Result<_>>()?;
        found.bundles += round.len();
        for (rays, took) in round {
            found.rays = found.rays.plus(rays);
            // Threads that wait for the last of a few bundles have no share in a long pass.
            found.seconds += took / threads;
        }
        count *= 2;
    }
    Ok(found)
}

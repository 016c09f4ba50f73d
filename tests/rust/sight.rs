//! Texel columns: bits that come back as they went in, values by their definition, files that lie.

use _core::basis::cubemap::{around, texel_direction};
use _core::light::{EnvironmentMap, Layout, Rows};
use _core::transport::sight::{Encoded, Seen, Sight, Texels, texel_columns};
use proptest::prelude::*;

use crate::transport::noise;

/// Rows with random normals; what they see is coherent, as the sky behind a few half-planes.
fn seen(size: usize, rows: usize, seed: u64) -> Seen {
    let mut random = noise(seed);
    let mut point = move || -> [f64; 3] { std::array::from_fn(|_| random()) };
    let normals: Vec<[f32; 3]> = (0..rows)
        .map(|row| {
            let n = point();
            let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
            n.map(|x| if row == 3 { 0.0 } else { (x / length) as f32 })
        })
        .collect();
    let edges: Vec<[f64; 3]> = (0..rows).map(|_| point()).collect();
    let columns = texel_columns(size);
    let open = |texel: usize| {
        let d = columns[texel].direction.map(f64::from);
        (0..rows).fold(0, |bits, row| {
            let side: f64 = (0..3).map(|k| edges[row][k] * d[k]).sum();
            bits | u64::from(side > 0.1 * edges[row % 7][0]) << row
        })
    };
    Seen { normals, open: (0..columns.len()).map(open).collect(), means: Vec::new() }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// Every bit above a horizon comes back, and norms are those of the columns.
    #[test]
    fn what_is_seen_comes_back(seed: u64, level in 0u32..6, rows in 1usize..=64, more in 0usize..=64) {
        let size = 1 << level;
        let bundles: Vec<Seen> = [(rows, seed), (more, seed ^ 1)]
            .into_iter().filter(|&(rows, _)| rows > 0).map(|(rows, seed)| seen(size, rows, seed)).collect();
        // Only the last bundle of a tile may be short.
        let bundles = if rows < 64 { &bundles[..1] } else { &bundles[..] };
        let parts: Vec<Encoded> = bundles.iter().map(|seen| Encoded::new(seen, size, -24, vec![0; 4])).collect();
        let sight = Sight::join(size, -24, None, &parts);
        prop_assert_eq!(sight.check(), Ok(()));
        let columns = texel_columns(size);
        for (bundle, seen) in bundles.iter().enumerate() {
            let mut squares = vec![0.0; seen.normals.len()];
            let mut masks = vec![0; columns.len()];
            sight.masks(bundle, &Texels::new(size, 0..columns.len()), &mut masks);
            for (texel, column) in columns.iter().enumerate() {
                // Alone, too.
                let mut mask = [0];
                sight.masks(bundle, &Texels::new(size, [texel]), &mut mask);
                let [mask] = mask;
                prop_assert_eq!(mask, masks[texel]);
                for (row, normal) in seen.normals.iter().enumerate() {
                    let cosine: f32 = (0..3).map(|k| normal[k] * column.direction[k]).sum();
                    if cosine > 1e-6 {
                        prop_assert_eq!(mask >> row & 1, seen.open[texel] >> row & 1);
                    }
                    let group = bundle * 4 + row / 16;
                    let value = f64::from(sight.lanes(group, (mask >> (row / 16 * 16)) as u16, texel)[row % 16]);
                    let truth = f64::from(cosine.max(0.0)) * f64::from(column.factor) * (seen.open[texel] >> row & 1) as f64;
                    prop_assert!((value - truth).abs() <= 2f64.powi(-25) + 1e-6 * truth, "{} {}", value, truth);
                    prop_assert_eq!(value * 2f64.powi(24), (value * 2f64.powi(24)).round());
                    squares[row] += value * value;
                }
            }
            for (norms, square) in parts[bundle].norms().zip(squares) {
                let kept = f64::from(f32::from_bits(u32::from(norms[0]) << 16));
                prop_assert!(kept * kept >= square && kept <= 1.01 * square.sqrt() + 1e-6);
            }
        }
    }

    /// A stream that was tampered with is refused, or read without leaving it.
    #[test]
    fn damaged_masks_are_refused_or_harmless(seed: u64, place: prop::sample::Index, byte: u8, block: prop::sample::Index, start: u32) {
        let encoded = [Encoded::new(&seen(8, 64, seed), 8, -24, vec![0; 4])];
        let whole = Sight::join(8, -24, None, &encoded);
        if whole.stream.is_empty() {
            return Ok(());
        }
        let mut stream = whole.stream.to_vec();
        stream[place.index(whole.stream.len())] = byte;
        let mut blocks = whole.blocks.to_vec();
        if start % 3 == 0 {
            blocks[block.index(whole.blocks.len())] = start;
        }
        let sight = Sight { stream: stream.into(), blocks: blocks.into(), ..whole };
        if sight.check().is_ok() {
            sight.masks(0, &Texels::new(8, 0..384), &mut vec![0; 384]);
        }
    }

    /// A point of light is shared among the texels around it: all of it, its middle kept, and without a jump.
    #[test]
    fn shares_keep_the_middle(x in -1.0f64..1.0, y in -1.0f64..1.0, z in -1.0f64..1.0, level in 0u32..7, edge in 0usize..4) {
        let size = 1 << level;
        let mut point = [x, y, z];
        // Often near the edges and the corners of faces.
        if edge > 0 { point[1] = point[0] * (1.0 + 0.3 * z / size as f64); }
        if edge > 1 { point[2] = point[0] * (1.0 + 0.3 * y / size as f64); }
        prop_assume!(point.iter().any(|c| c.abs() > 1e-3));
        let length = point.iter().map(|c| c * c).sum::<f64>().sqrt();
        let direction = point.map(|c| c / length);
        let centre = |texel: usize| texel_direction(size, texel / (size * size), texel / size % size, texel % size);
        let shares = around(size, direction);
        prop_assert!((1..=4).contains(&shares.len()) && shares.iter().all(|share| share.1 > 0.0));
        prop_assert!((shares.iter().map(|share| share.1).sum::<f64>() - 1.0).abs() < 1e-12);
        let middle: [f64; 3] = std::array::from_fn(|k| shares.iter().map(|&(texel, share)| share * centre(texel)[k]).sum());
        let length = middle.iter().map(|c| c * c).sum::<f64>().sqrt();
        let cosine: f64 = (0..3).map(|k| middle[k] * direction[k]).sum::<f64>() / length;
        prop_assert!(cosine > 1.0 - 1e-9, "{} {:?}", cosine, shares);

        // A step of a thousandth of a texel changes no share by more than a few thousandths.
        let near = direction.map(|c| c + 1e-3 / size as f64 * (c * 37.0).sin());
        let moved = around(size, near);
        for (texel, share) in shares.iter().chain(&moved) {
            let of = |all: &[(usize, f64)]| all.iter().filter(|s| s.0 == *texel).map(|s| s.1).sum::<f64>();
            prop_assert!((of(&shares) - of(&moved)).abs() < 8e-3, "{} {:?} {:?}", share, shares, moved);
        }
    }
}

/// One lit pixel of a fine map is one peak, towards it and of its flux, however the map is turned; the rest stays behind.
#[test]
fn a_sun_is_one_peak() {
    let (width, height) = (1024, 512);
    let mut pixels = vec![[0.5f32; 3]; width * height];
    // Three pixels beside each other, in the middle of the upper half.
    for column in 300..303 {
        pixels[128 * width + column] = [9000.0, 6000.0, 3000.0];
    }
    let map = EnvironmentMap::new(Layout::LatLong { width, height, rows: Rows::Centre }, pixels).unwrap();
    let one = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let peaks = map.peaks(64, &one, 8);
    assert_eq!(peaks.len(), 1, "{peaks:?}");
    let angle = std::f64::consts::PI * 128.5 / height as f64;
    let area = 2.0 * std::f64::consts::PI / width as f64 * std::f64::consts::PI / height as f64 * angle.sin();
    assert!((peaks[0].flux[0] / (3.0 * 9000.0 * area) - 1.0).abs() < 0.01);
    let u = 2.0 * std::f64::consts::PI * 301.5 / width as f64;
    let towards = [angle.sin() * u.sin(), angle.cos(), -angle.sin() * u.cos()];
    assert!((0..3).all(|k| (peaks[0].direction[k] - towards[k]).abs() < 1e-3), "{:?} {towards:?}", peaks[0]);

    // Turned by a quarter about y: x to -z.
    let quarter = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]];
    let turned = map.peaks(64, &quarter, 8)[0];
    assert!((turned.direction[2] + peaks[0].direction[0]).abs() < 1e-12);
    let (mut radiance, mut texels) = (vec![[0.0; 3]; 6 * 64 * 64], vec![[0.0; 3]; 6 * 64 * 64]);
    map.split(64, &quarter, [2.0; 3], 8, &mut radiance, &mut texels);
    let most = radiance.iter().map(|texel| texel[0]).fold(0.0f32, f32::max);
    assert!(most < 9.0, "{most}");
    let areas = _core::basis::cubemap::solid_angles(64);
    let flux: f64 = texels.iter().enumerate().map(|(k, texel)| texel[1] * areas[k % 4096].sqrt()).sum();
    assert!((flux / (2.0 * peaks[0].flux[1]) - 1.0).abs() < 1e-9);
}

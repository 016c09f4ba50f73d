//! Transport: truncation and tiles against the dense oracle.

use _core::basis::ColumnSpace;
use _core::error::Error;
use _core::transport::entry::{entry_bytes, power_of_two};
use _core::transport::truncate::compress_portable;
use _core::transport::{
    Channels, CompressedGroup, Dense, GROUP, Measure, RowNorms, Rows16, Survey, TransportMatrix, Truncation, Width,
    bf16, bf16_up, compress_group,
};
use _core::update::Span;
use proptest::prelude::*;

const QUANTUM: i32 = -24;

/// A reproducible stream of numbers in [-1, 1).
pub fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(2).wrapping_add(1);
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Rows with magnitudes over several octaves, zeros, empty columns and an empty row.
pub fn random_dense(space: ColumnSpace, rows: usize, channels: Channels, seed: u64) -> Dense {
    let (columns, count) = (space.columns(), channels.count());
    let mut next = noise(seed);
    let scales: Vec<f64> = (0..columns).map(|_| next().max(0.0).powi(6)).collect();
    let mut values: Vec<f64> = (0..rows * columns * count).map(|k| next() * scales[k / count % columns]).collect();
    values.iter_mut().for_each(|value| *value = f64::from(*value as f32));
    if rows > 2 {
        values[columns * count..2 * columns * count].fill(0.0);
    }
    Dense::with_channels(rows, columns, channels, values)
}

pub fn rule(space: ColumnSpace, threshold: f64, width: Width) -> Truncation {
    Truncation::new(&space.bands(), threshold, QUANTUM, width).unwrap()
}

pub fn matrix(space: ColumnSpace, rows: usize, channels: Channels, seed: u64, width: Width) -> TransportMatrix {
    random_dense(space, rows, channels, seed).compress(space, &rule(space, 0.0, width), 32).unwrap()
}

/// L2 norm of each row in each band and channel of a - b.
fn band_norms(a: &Dense, b: &Dense, space: ColumnSpace) -> Vec<f64> {
    let (bands, channels) = (space.bands(), a.channels.count());
    let norm = |row: usize, band: usize, channel: usize| {
        let of = |dense: &Dense, column: usize| dense.row(row)[column * channels + channel];
        bands.range(band).map(|column| (of(a, column) - of(b, column)).powi(2)).sum::<f64>().sqrt()
    };
    let mut norms = Vec::new();
    for (row, band) in (0..a.rows).flat_map(|row| (0..bands.count()).map(move |band| (row, band))) {
        norms.extend((0..channels).map(|channel| norm(row, band, channel)));
    }
    norms
}

pub fn stored_norms(matrix: &TransportMatrix, of: fn(&_core::transport::Tile) -> &[u16]) -> Vec<f64> {
    matrix.tiles.iter().flat_map(|tile| of(tile).iter()).map(|&bits| f64::from(bf16(bits))).collect()
}

fn width_strategy() -> impl Strategy<Value = Width> {
    prop_oneof![Just(Width::I8), Just(Width::I16)]
}

fn channels_strategy() -> impl Strategy<Value = Channels> {
    prop_oneof![Just(Channels::One), Just(Channels::Three)]
}

/// What a pass hands over.
fn views(planes: &[Vec<Rows16>]) -> Vec<&[Rows16]> {
    planes.iter().map(Vec::as_slice).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Every stored value is the nearest multiple of its entry's step, the step is the least that fits, and both losses
    /// and remains are stated from above by no more than a bfloat16 step.
    #[test]
    fn truncation_keeps_its_word(seed: u64, rows in 1usize..70, log_size in 0u32..4, width in width_strategy(), channels in channels_strategy(), threshold in 0.0f64..1.0) {
        let space = ColumnSpace::haar(1 << log_size).unwrap();
        let dense = random_dense(space, rows, channels, seed);
        let matrix = dense.compress(space, &rule(space, threshold, width), 32).unwrap();
        let stored = Dense::of(&matrix);

        let lost = band_norms(&dense, &stored, space);
        let zero = Dense::with_channels(rows, dense.columns, channels, vec![0.0; dense.values.len()]);
        let kept = band_norms(&stored, &zero, space);
        for (truth, stated) in [(lost, stored_norms(&matrix, |tile| &tile.dropped)), (kept, stored_norms(&matrix, |tile| &tile.kept))] {
            for (truth, stated) in truth.iter().zip(&stated) {
                prop_assert!(truth <= stated, "{truth} is stated as {stated}");
                prop_assert!(*stated <= truth * 1.008 + 1e-19, "{truth} is stated as {stated}");
                prop_assert_eq!(*truth == 0.0, *stated == 0.0);
            }
        }

        let bands = space.bands();
        for first in (0..rows).step_by(GROUP) {
            let planes = dense.planes(first);
            for column in 0..dense.columns {
                // The entry's numbers in all channels, and what is stored of them.
                let entry: Vec<f32> = planes.iter().flat_map(|plane| plane[column]).collect();
                let energy: f64 = entry.iter().map(|&x| f64::from(x).powi(2)).sum();
                let weighed = energy * bands.areas[column];
                let at = |k: usize| (first + k % GROUP, k / GROUP);
                let inside: Vec<usize> = (0..entry.len()).filter(|&k| at(k).0 < rows).collect();
                let stored: Vec<f64> =
                    inside.iter().map(|&k| stored.row(at(k).0)[column * channels.count() + at(k).1]).collect();
                let largest = entry.iter().fold(0.0f64, |most, &x| most.max(f64::from(x).abs()));
                let mut step = f64::from(power_of_two(QUANTUM));
                while (largest / step).round_ties_even() > f64::from(width.max()) {
                    step *= 2.0;
                }
                if stored.iter().all(|&value| value == 0.0) {
                    // Dropped: too weak together, or nothing but zeros after rounding.
                    let weak = column >= 6 && weighed <= threshold * threshold * (1.0 + 1e-5);
                    prop_assert!(weak || largest <= step / 2.0);
                } else {
                    prop_assert!(column < 6 || weighed >= threshold * threshold * (1.0 - 1e-5));
                    for (value, &k) in stored.iter().zip(&inside) {
                        prop_assert_eq!(*value, (f64::from(entry[k]) / step).round_ties_even() * step);
                    }
                }
            }
        }
    }

    /// The two paths give the same bits.
    #[test]
    fn instruction_sets_agree(seed: u64, threshold in 0.0f64..1.0, beside in 0.0f64..100.0, width in width_strategy(), channels in channels_strategy()) {
        let space = ColumnSpace::haar(8).unwrap();
        let planes = random_dense(space, GROUP, channels, seed).planes(0);
        let planes = views(&planes);
        let (mut a, mut b) = (CompressedGroup::default(), CompressedGroup::default());
        compress_group(&planes, &space.bands(), &rule(space, threshold, width), beside, &mut a).unwrap();
        compress_portable(&planes, &space.bands(), &rule(space, threshold, width), beside, &mut b).unwrap();
        prop_assert_eq!(format!("{a:?}"), format!("{b:?}"));
    }

    /// Norms round up, to the next bfloat16 and no further; zero stays zero.
    #[test]
    fn bfloat16_rounds_up(bits in 0u32..0x7f00_0000, wobble in 0u32..1 << 29) {
        let norm = f64::from_bits(f64::from(f32::from_bits(bits)).to_bits() + u64::from(wobble));
        let up = bf16_up(norm);
        prop_assert!(f64::from(bf16(up)) >= norm);
        prop_assert!(up == 0 || f64::from(bf16(up - 1)) < norm);
    }

    /// Rows, the copy by rows and the norms of columns all come from the same numbers.
    #[test]
    fn every_reading_agrees(seed: u64, rows in 1usize..70, width in width_strategy(), channels in channels_strategy()) {
        let space = ColumnSpace::haar(4).unwrap();
        let matrix = matrix(space, rows, channels, seed, width);
        let (dense, count) = (Dense::of(&matrix), channels.count());

        let mut copy = vec![0.0; dense.values.len()];
        for channel in 0..count {
            let csr = matrix.to_csr(channel);
            for row in 0..rows {
                let range = csr.indptr[row] as usize..csr.indptr[row + 1] as usize;
                prop_assert!(csr.indices[range.clone()].windows(2).all(|pair| pair[0] < pair[1]));
                for k in range {
                    let place = (row * dense.columns + csr.indices[k] as usize) * count + channel;
                    copy[place] = f64::from(csr.data[k]);
                }
            }
            prop_assert!(csr.data.iter().all(|&value| value != 0.0));
        }
        prop_assert_eq!(&copy, &dense.values);

        for column in 0..dense.columns {
            let value = |row: usize, channel: usize| dense.row(row)[column * count + channel];
            let squares = (0..rows).flat_map(|row| (0..count).map(move |channel| value(row, channel).powi(2)));
            let norm = squares.sum::<f64>().sqrt();
            prop_assert!((matrix.column_norms()[column] - norm).abs() <= 1e-12 * norm);
        }
        let entries: u32 = matrix.column_entries().iter().sum();
        prop_assert_eq!(entries as usize, matrix.entries());
    }

    /// However long a row is (a narrow lobe, plain random numbers), it spans no more bits than exact sums can take, and
    /// neighbouring groups of ordinary rows keep their unit.
    #[test]
    fn long_rows_have_units_of_their_own(seed: u64, size in -2.0f64..12.0, width in width_strategy()) {
        let space = ColumnSpace::haar(4).unwrap();
        let mut dense = random_dense(space, 3 * GROUP, Channels::One, seed);
        let ordinary = dense.compress(space, &rule(space, 0.0, width), GROUP).unwrap();
        for value in &mut dense.values[GROUP * space.columns()..2 * GROUP * space.columns()] {
            *value = f64::from((*value * size.exp2()) as f32);
        }
        let matrix = dense.compress(space, &rule(space, 0.0, width), GROUP).unwrap();
        prop_assert!(Span::of(&matrix).0 <= 27);
        for tile in [0, 2] {
            prop_assert_eq!(&matrix.tiles[tile].words[..], &ordinary.tiles[tile].words[..]);
        }
        let lost = band_norms(&dense, &Dense::of(&matrix), space);
        for (truth, stated) in lost.iter().zip(stored_norms(&matrix, |tile| &tile.dropped)) {
            prop_assert!(*truth <= stated);
        }
    }

    /// What a smaller version states as lost is never below what it lost of the original rows.
    #[test]
    fn truncating_twice_states_the_whole_loss(seed: u64, first in 0.0f64..0.5, second in 0.0f64..1.0) {
        let space = ColumnSpace::haar(4).unwrap();
        let dense = random_dense(space, 40, Channels::One, seed);
        let once = dense.compress(space, &rule(space, first, Width::I16), 32).unwrap();
        let twice = once.truncated(&rule(space, second, Width::I8)).unwrap();
        let lost = band_norms(&dense, &Dense::of(&twice), space);
        for (truth, stated) in lost.iter().zip(stored_norms(&twice, |tile| &tile.dropped)) {
            prop_assert!(*truth <= stated);
        }
        prop_assert!(twice.entries() <= once.entries());
    }

    /// The error that a threshold was chosen for is the error that it makes, under the prior it was chosen under.
    #[test]
    fn thresholds_meet_their_tolerance(seed: u64, tolerance in 0.02f64..0.5, channels in channels_strategy()) {
        let space = ColumnSpace::haar(8).unwrap();
        let (bands, dense) = (space.bands(), random_dense(space, 64, channels, seed));
        let mut survey = Survey::new(&bands, &rule(space, 0.0, Width::I8), std::sync::Arc::default()).unwrap();
        (0..4).for_each(|group| survey.add(&views(&dense.planes(16 * group))).unwrap());
        let choice = survey.threshold_for(tolerance).unwrap();
        let matrix = dense.compress(space, &rule(space, choice.value, Width::I8), 64).unwrap();
        let stored = Dense::of(&matrix);
        let (mut lost, mut all) = (0.0, 0.0);
        for (k, (truth, stored)) in dense.values.iter().zip(&stored.values).enumerate() {
            lost += (truth - stored).powi(2) * bands.areas[k / channels.count() % dense.columns];
            all += truth.powi(2) * bands.areas[k / channels.count() % dense.columns];
        }
        prop_assert!(choice.error <= tolerance);
        prop_assert!(((lost / all).sqrt() - choice.error).abs() <= 1e-3 * choice.error, "{} {}", (lost / all).sqrt(), choice.error);
        prop_assert!((choice.entries_per_group - matrix.entries() as f64 / 4.0).abs() < 1e-9);
    }

    /// An error that is measured under lights is that of products, and the worst of those that decide keeps the tolerance.
    #[test]
    fn measured_errors_are_those_of_products(seed: u64, tolerance in 0.02f64..0.5, channels in channels_strategy()) {
        let space = ColumnSpace::haar(8).unwrap();
        let (bands, dense) = (space.bands(), random_dense(space, 64, channels, seed));
        let mut random = noise(seed ^ 7);
        let mut light = || -> Vec<[f64; 3]> {
            bands.areas.iter().map(|area| std::array::from_fn(|_| area.sqrt() * random().powi(5))).collect()
        };
        let lights: Vec<Measure> = [true, true, false]
            .map(|decides| Measure { truncated: light(), whole: light(), decides })
            .into();
        let rule_of = |threshold| rule(space, threshold, Width::I8);
        let mut parts = [0, 1].map(|_| Survey::new(&bands, &rule_of(0.0), lights.clone().into()).unwrap());
        (0..4).for_each(|group| parts[group % 2].add(&views(&dense.planes(16 * group))).unwrap());
        let [mut survey, other] = parts;
        survey.merge(&other);
        let choice = survey.threshold_for(tolerance).unwrap();
        let stored = Dense::of(&dense.compress(space, &rule_of(choice.value), 64).unwrap());
        for (light, &error) in lights.iter().zip(&choice.errors) {
            let product = |dense: &Dense, light: &[[f64; 3]]| dense.multiply(light.as_flattened(), 3);
            let (kept, truth) = (product(&stored, &light.truncated), product(&dense, &light.truncated));
            let lost: f64 = kept.iter().zip(&truth).map(|(a, b)| (a - b).powi(2)).sum();
            let whole: f64 = product(&dense, &light.whole).iter().map(|b| b * b).sum();
            prop_assert!(((lost / whole).sqrt() - error).abs() <= 1e-6 + 1e-3 * error, "{} {}", (lost / whole).sqrt(), error);
        }
        prop_assert_eq!(choice.error, choice.errors[0].max(choice.errors[1]));
        prop_assert!(choice.error <= tolerance || choice.value == 0.0);
    }
}

/// A row with one value v in a fine column (area 4 of haar:4 has weight 2 for 2x2 blocks): dropped from threshold 2|v|
/// on.
#[test]
fn the_threshold_weighs_by_the_root_of_the_area() {
    let space = ColumnSpace::haar(4).unwrap();
    let bands = space.bands();
    let column = bands.range(1).start;
    assert_eq!(bands.areas[column], 4.0);
    let mut lanes = vec![[0.0; GROUP]; bands.columns()];
    lanes[column][3] = 0.25;
    lanes[0][0] = 2.0f32.powi(-20);
    for (threshold, expected) in [(0.5, vec![0, column as u32]), (0.51, vec![0])] {
        let mut out = CompressedGroup::default();
        compress_group(&[&lanes], &bands, &rule(space, threshold, Width::I8), 0.0, &mut out).unwrap();
        // The scaling column stays however small it is.
        assert_eq!(out.columns, expected);
    }
}

#[test]
fn coefficients_that_cannot_be_stored_are_refused() {
    let space = ColumnSpace::haar(2).unwrap();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 2.0e6, 1e30] {
        for column in [0, 20] {
            let mut lanes = vec![[0.0; GROUP]; space.columns()];
            lanes[column][5] = bad;
            let found =
                compress_group(&[&lanes], &space.bands(), &rule(space, 0.1, Width::I8), 0.0, &mut Default::default());
            assert!(matches!(found, Err(Error::Input(_))), "{bad} in column {column}");
        }
    }
    for (threshold, quantum) in [(f64::NAN, QUANTUM), (-1.0, QUANTUM), (0.0, -65), (0.0, 14)] {
        assert!(Truncation::new(&space.bands(), threshold, quantum, Width::I8).is_err());
    }
}

/// Norms of both stages stand row by row, in bands and channels; arrays of other sizes, or with norms that are none, are
/// refused.
#[test]
fn norms_of_two_stages_stand_row_by_row() {
    let numbers = |from: u16| (from..from + 18).collect::<Vec<_>>();
    let norms = RowNorms::new(3, Channels::Three, numbers(0).into(), numbers(100).into()).unwrap();
    assert_eq!((norms.rows(), norms.shape(), norms.nbytes()), (2, (3, Channels::Three), 72));
    assert_eq!(norms.row(1), (&numbers(0)[9..], &numbers(100)[9..]));
    let of = |kept: Vec<u16>, dropped: Vec<u16>| RowNorms::new(3, Channels::Three, kept.into(), dropped.into());
    assert!(of(vec![0; 10], vec![0; 10]).is_err() && of(vec![0; 9], vec![0; 18]).is_err());
    for wrong in [0x7f80, 0x7fc0, 0x8000, 0xffff] {
        assert!(of(vec![0; 9], vec![wrong; 9]).is_err() && of(vec![wrong; 9], vec![0; 9]).is_err());
        assert!(of(vec![0x7f7f; 9], vec![0; 9]).is_ok());
    }
    assert!(RowNorms::new(0, Channels::One, vec![].into(), vec![].into()).is_err());
}

#[test]
fn an_entry_is_a_word_and_integers_of_sixteen_rows() {
    let bytes = [(Width::I8, Channels::One), (Width::I16, Channels::One), (Width::I8, Channels::Three)];
    assert_eq!(bytes.map(|(width, channels)| entry_bytes(width, channels)), [18, 34, 50]);
}

//! B = M V in every way it is computed, against sums of 128-bit integers, which round nothing.

use _core::basis::ColumnSpace;
use _core::transport::{Channels, CompressedGroup, GROUP, Tile, TransportMatrix, Width};
use _core::update::kernel::Engine;
use _core::update::multiply_gridded;
use _core::update::{
    Applied, Bound, Grid, Measured, Response, Span, Term, Update, bound_rows, finish_bounds, light_norm, multiply,
};
use proptest::prelude::*;

type Light = Vec<[f64; 3]>;

/// xorshift64*.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33) as usize % n
    }

    /// Between -1 and 1.
    fn signed(&mut self) -> f64 {
        self.below(1 << 30) as f64 / (1 << 29) as f64 - 1.0
    }
}

/// A random transport, its integers in units of 2^quantum, and what truncation took from it.
struct Case {
    matrix: TransportMatrix,
    /// `[row][column]`.
    integers: Vec<Vec<i64>>,
    dropped: Vec<Vec<f64>>,
}

/// bfloat16, rounded up.
fn norm_up(x: f64) -> u16 {
    let single = (x as f32).next_up();
    ((single.to_bits() + 0xffff) >> 16) as u16
}

fn case(seed: u64, width: Width) -> Case {
    let mut random = Random(seed | 1);
    let space = ColumnSpace::haar(4).unwrap();
    let bands = space.bands();
    let rows = 1 + random.below(150);
    let tile_rows = GROUP * (1 + random.below(4));
    let quantum = random.below(30) as i32 - 20;
    let columns = bands.columns();
    // Nearly empty columns are sorted, others are marked (`kernel::batches`).
    let fill = [3, 20, 50, 90][random.below(4)];
    let mut integers = vec![vec![0i64; columns]; rows.next_multiple_of(GROUP)];
    let mut dropped = vec![vec![0.0; columns]; rows.next_multiple_of(GROUP)];

    let norms = |lanes: &[Vec<f64>]| -> Vec<u16> {
        let norm = |row: &[f64]| norm_up(row.iter().map(|x| x * x).sum::<f64>().sqrt() * (1.0 + 1e-12));
        lanes.iter().flat_map(|row| (0..bands.count()).map(|b| norm(&row[bands.range(b)]))).collect()
    };
    let mut tiles = Vec::new();
    for first in (0..rows).step_by(tile_rows) {
        let here = tile_rows.min(rows - first);
        let mut groups = Vec::new();
        for start in (first..first + here).step_by(GROUP) {
            let mut group = CompressedGroup::default();
            for column in (0..columns).filter(|column| column % 7 != 3) {
                if random.below(100) >= fill {
                    continue;
                }
                let shift = random.below(7) as u8;
                group.columns.push(column as u32);
                group.shifts.push(shift);
                for lane in 0..GROUP {
                    let inside = start + lane < first + here;
                    let value = if inside { (random.signed() * width.max() as f64) as i16 } else { 0 };
                    group.values.push(value);
                    integers[start + lane][column] = (value as i64) << shift;
                }
            }
            let unit = 2f64.powi(quantum);
            for row in &mut dropped[start..start + GROUP] {
                row.iter_mut().for_each(|x| *x = random.signed() * unit);
            }
            let stored: Vec<Vec<f64>> = integers[start..start + GROUP]
                .iter()
                .map(|row| row.iter().map(|&x| x as f64 * unit).collect())
                .collect();
            group.kept = norms(&stored);
            group.dropped = norms(&dropped[start..start + GROUP]);
            groups.push(group);
        }
        tiles.push(Tile::assemble(here, columns, Channels::One, (width, quantum), &groups));
    }
    integers.truncate(rows);
    dropped.truncate(rows);
    Case {
        matrix: TransportMatrix { space, bands, rows, channels: Channels::One, quantum, tile_rows, tiles },
        integers,
        dropped,
    }
}

fn light(random: &mut Random, columns: usize, scale: f64) -> Light {
    let mut colour = || if random.below(4) == 0 { 0.0 } else { random.signed().powi(5) * scale };
    (0..columns).map(|_| [colour(), colour(), colour()]).collect()
}

/// The true product with coefficients on a grid: rows x 3, without any rounding.
fn oracle(case: &Case, light: &[[f64; 3]], grid: Grid) -> Vec<f64> {
    let spacing = 2f64.powi(-grid.exponent);
    let units: Vec<[i128; 3]> = light
        .iter()
        .map(|colours| {
            colours.map(|x| {
                assert_eq!((x * spacing).fract(), 0.0, "a coefficient is off the grid");
                (x * spacing) as i128
            })
        })
        .collect();
    let mut product = Vec::new();
    for row in &case.integers {
        for colour in 0..3 {
            let sum: i128 = row.iter().zip(&units).map(|(&t, v)| t as i128 * v[colour]).sum();
            assert_eq!(sum as f64 as i128, sum, "a sum needs more than 53 bits");
            product.push(sum as f64 * 2f64.powi(case.matrix.quantum + grid.exponent));
        }
    }
    product
}

fn bits(picture: &[f32]) -> Vec<u32> {
    picture.iter().map(|x| x.to_bits()).collect()
}

fn rounded(product: &[f64]) -> Vec<u32> {
    product.iter().map(|&x| (x as f32).to_bits()).collect()
}

/// The state, as rows x 3 of bits.
fn state(case: &Case, response: &Response) -> Vec<u64> {
    let mut all = Vec::new();
    let mut groups = response.tiles().iter().flatten();
    for tile in &case.matrix.tiles {
        let sums: Vec<_> = groups.by_ref().take(tile.groups()).collect();
        for row in 0..tile.rows {
            all.extend((0..3).map(|colour| sums[row / GROUP].0[colour][row % GROUP].to_bits()));
        }
    }
    all
}

/// Brings some columns to `target`, after the reset of some bands.
fn some_update(random: &mut Random, case: &Case, applied: &mut Applied, target: &[[f64; 3]]) -> Update {
    let bands = &case.matrix.bands;
    let everything = random.below(8) == 0;
    let anew: Vec<bool> = (0..bands.count()).map(|_| everything || random.below(3) == 0).collect();
    let share = 1 + random.below(6);
    let sent: Vec<usize> = (0..bands.columns()).filter(|_| random.below(6) < share).collect();
    applied.send(bands, &anew, sent.into_iter().map(|column| (column, 0..3)), target)
}

fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

fn widths() -> impl Strategy<Value = Width> {
    prop_oneof![Just(Width::I8), Just(Width::I16)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// After any updates and resets the state is that of a fresh product, bit for bit, on any threads and any engine.
    #[test]
    fn any_history_leaves_the_bits_of_a_fresh_product(seed: u64, width in widths(), threads in 0usize..4) {
        let case = case(seed, width);
        let mut random = Random(seed ^ 0x9e37_79b9 | 1);
        let columns = case.matrix.bands.columns();
        let rows = Span::of(&case.matrix);
        let brightest = light(&mut random, columns, 1e5);
        let grid = Grid::for_light(light_norm(&brightest), rows, 3).unwrap();
        let mut picture = vec![f32::NAN; 3 * case.matrix.rows];
        let mut fast = Response::new(&case.matrix);
        let mut plain = Response::with_engine(&case.matrix, Engine::Portable);
        let mut applied = Applied::new(&case.matrix.bands);

        for _ in 0..6 {
            let scale = [1e5, 1.0, 1e-3][random.below(3)];
            let target = grid.quantise_all(&light(&mut random, columns, scale));
            prop_assert!(grid.holds(light_norm(&target) + light_norm(applied.values())));
            let update = some_update(&mut random, &case, &mut applied, &target);
            with_threads([1, 2, 3, 7][threads], || fast.apply(&case.matrix, &update, Some(&mut picture))).unwrap();

            let product = oracle(&case, applied.values(), grid);
            let exact: Vec<u64> = product.iter().map(|x| x.to_bits()).collect();
            prop_assert_eq!(state(&case, &fast), exact);
            prop_assert_eq!(bits(&picture), rounded(&product));

            let mut again = vec![f32::NAN; picture.len()];
            plain.apply(&case.matrix, &update, Some(&mut again)).unwrap();
            prop_assert_eq!(bits(&again), bits(&picture));
            prop_assert_eq!(state(&case, &plain), state(&case, &fast));

            for engine in [Engine::Portable, Engine::Native] {
                multiply_gridded(&case.matrix, &[applied.values()], engine, &mut again).unwrap();
                prop_assert_eq!(bits(&again), bits(&picture));
            }
        }
    }

    /// Several lights at once, each as by itself; mirrored and scaled lights give mirrored and scaled pictures.
    #[test]
    fn products_are_linear_bit_for_bit(seed: u64, width in widths(), lights in 1usize..7) {
        let case = case(seed, width);
        let mut random = Random(seed ^ 0x1234 | 1);
        let columns = case.matrix.bands.columns();
        let rows = Span::of(&case.matrix);
        let lights: Vec<Light> =
            (0..lights).map(|k| light(&mut random, columns, [1.0, 1e5, 1e-4][k % 3])).collect();
        let product = |lights: &[Light]| {
            let mut out = vec![f32::NAN; lights.len() * case.matrix.rows * 3];
            let lights: Vec<&[[f64; 3]]> = lights.iter().map(|light| &light[..]).collect();
            multiply(&case.matrix, rows, &lights, &mut out).unwrap();
            out
        };
        let together = product(&lights);
        let scaled = |factor: f64| -> Vec<Light> {
            lights.iter().map(|light| light.iter().map(|c| c.map(|x| x * factor)).collect()).collect()
        };

        for (light, picture) in lights.iter().zip(together.chunks(case.matrix.rows * 3)) {
            let grid = Grid::for_light(light_norm(light), rows, 1).unwrap();
            prop_assert_eq!(bits(picture), rounded(&oracle(&case, &grid.quantise_all(light), grid)));
        }
        let gridded = |light: &Light| Grid::for_light(light_norm(light), rows, 1).unwrap().quantise_all(light);
        let gridded: Vec<Light> = lights.iter().map(gridded).collect();
        let gridded: Vec<&[[f64; 3]]> = gridded.iter().map(|light| &light[..]).collect();
        let mut portable = vec![f32::NAN; together.len()];
        multiply_gridded(&case.matrix, &gridded, Engine::Portable, &mut portable).unwrap();
        prop_assert_eq!(bits(&portable), bits(&together));
        for (x, y) in together.iter().zip(product(&scaled(-1.0))) {
            prop_assert_eq!(x + y, 0.0);
        }
        for exponent in [-40, 40] {
            let factor = 2f64.powi(exponent);
            let expected: Vec<f32> = together.iter().map(|x| x * factor as f32).collect();
            prop_assert_eq!(bits(&product(&scaled(factor))), bits(&expected));
        }
    }

    /// No receiver is ever further from the untruncated product than its bound, nor its bound above the one number.
    #[test]
    fn the_bound_holds(seed: u64, width in widths(), scale in prop_oneof![Just(1.0), Just(1e5)]) {
        let case = case(seed, width);
        let mut random = Random(seed ^ 0x77 | 1);
        let bands = &case.matrix.bands;
        let span = Span::of(&case.matrix);
        let target = light(&mut random, bands.columns(), scale);
        let grid = Grid::for_light(light_norm(&target), span, 2).unwrap();
        let mut response = Response::new(&case.matrix);
        let mut picture = vec![0.0; 3 * case.matrix.rows];
        let mut applied = Applied::new(bands);
        let update = some_update(&mut random, &case, &mut applied, &grid.quantise_all(&target));
        response.apply(&case.matrix, &update, Some(&mut picture)).unwrap();

        let measured = Measured::new(bands, &target, applied.values());
        prop_assert!(measured.applied >= light_norm(applied.values()) * (1.0 - 1e-15));
        let mut bounds = vec![0.0; picture.len()];
        let rows = bound_rows(&case.matrix, &measured);
        finish_bounds(&picture, &mut bounds, |row, add| add(rows[row], 1.0));
        let largest = Bound::new(&case.matrix).largest(&measured);
        let unit = 2f64.powi(case.matrix.quantum);
        for (i, (stored, dropped)) in case.integers.iter().zip(&case.dropped).enumerate() {
            for colour in 0..3 {
                let terms = stored.iter().zip(dropped).zip(&target);
                let truth: f64 = terms.map(|((&t, d), v)| (t as f64 * unit + d) * v[colour]).sum();
                let error = (truth - picture[3 * i + colour] as f64).abs();
                // The oracle's own f64 rounding, far below the bound.
                let slack = 1e-12 * bounds[3 * i + colour] as f64;
                prop_assert!(error <= bounds[3 * i + colour] as f64 + slack);
                prop_assert!(bounds[3 * i + colour] as f64 <= largest[colour] * (1.0 + 1e-6));
            }
        }
    }

    /// Rounding to a grid: odd, idempotent, within half a spacing, and of no effect on what is coarser already.
    #[test]
    fn a_grid_rounds_evenly(x in -1e38f64..1e38, norm_exponent in -120i32..127, span in 0i32..20) {
        let rows = Span(span);
        let norm = 2f64.powi(norm_exponent) * 1.25;
        let grid = Grid::for_light(norm, rows, 4).unwrap();
        prop_assert!(grid.holds(16.0 * norm) && !grid.holds(33.0 * norm));
        let spacing = 2f64.powi(grid.exponent);
        let x = x / 1e38 * norm;
        let on_grid = grid.quantise(x);
        prop_assert!((on_grid - x).abs() <= 0.5 * spacing);
        prop_assert_eq!(grid.quantise(-x), -on_grid);
        prop_assert_eq!(grid.quantise(on_grid), on_grid);
        let doubled = Grid::for_light(2.0 * norm, rows, 4).unwrap();
        prop_assert_eq!(doubled.quantise(2.0 * x), 2.0 * on_grid);
        prop_assert_eq!(grid.quantise(doubled.quantise(x)), doubled.quantise(x));
    }
}

/// A loop of light, run a thousand times, ends each time where it began (f32 sums lose 1e-8 a frame).
#[test]
fn a_repeating_light_does_not_drift() {
    let case = case(11, Width::I8);
    let mut random = Random(5);
    let columns = case.matrix.bands.columns();
    let frames: Vec<Light> = (0..10).map(|k| light(&mut random, columns, [1e5, 1.0][k % 2])).collect();
    let norm = frames.iter().map(|frame| light_norm(frame)).fold(0.0, f64::max);
    let grid = Grid::for_light(norm, Span::of(&case.matrix), 2).unwrap();
    let frames: Vec<Light> = frames.iter().map(|frame| grid.quantise_all(frame)).collect();
    let mut response = Response::new(&case.matrix);
    let mut picture = vec![0.0; 3 * case.matrix.rows];
    let mut applied = Applied::new(&case.matrix.bands);
    let mut first = None;
    for _ in 0..1000 {
        for frame in &frames {
            let none = vec![false; case.matrix.bands.count()];
            let update = applied.send(&case.matrix.bands, &none, (0..columns).map(|column| (column, 0..3)), frame);
            response.apply(&case.matrix, &update, Some(&mut picture)).unwrap();
        }
        let now = state(&case, &response);
        assert_eq!(*first.get_or_insert_with(|| now.clone()), now);
    }
}

/// Zero, tiny and huge lights have grids of their own; what is not finite has none.
#[test]
fn lights_of_any_size_have_a_grid() {
    let case = case(3, Width::I16);
    let rows = Span::of(&case.matrix);
    let columns = case.matrix.bands.columns();
    for size in [0.0, 1e-38, 1e38] {
        let grid = Grid::for_light(light_norm(&vec![[size; 3]; columns]), rows, 6).unwrap();
        assert!((grid.quantise(size) - size).abs() <= 1e-6 * size);
    }
    for wrong in [f64::NAN, f64::INFINITY] {
        let mut light = vec![[1.0; 3]; columns];
        light[columns / 2][1] = wrong;
        assert!(Grid::for_light(light_norm(&light), rows, 6).is_err());
    }
    assert!(Grid::for_light(1.0, Span(40), 1).is_err());
}

/// Rows span from the unit that their group's entries share, and not from the quantum: a long row of coarse entries can be
/// followed exactly, one that has fine entries as well says that it cannot.
#[test]
fn rows_span_from_the_unit_of_their_group() {
    let space = ColumnSpace::haar(1).unwrap();
    let bands = space.bands();
    let span = |columns: &[(u32, u8, i16)]| {
        let value = |&(_, shift, integer): &(u32, u8, i16)| f64::from(integer) * 2f64.powi(i32::from(shift) - 24);
        let norm = columns.iter().map(|entry| value(entry).powi(2)).sum::<f64>().sqrt();
        let group = CompressedGroup {
            columns: columns.iter().map(|entry| entry.0).collect(),
            shifts: columns.iter().map(|entry| entry.1).collect(),
            values: columns.iter().flat_map(|entry| [entry.2; GROUP]).collect(),
            kept: vec![norm_up(norm); GROUP * bands.count()],
            dropped: vec![0; GROUP * bands.count()],
            ..CompressedGroup::default()
        };
        let tiles = vec![Tile::assemble(GROUP, space.columns(), Channels::One, (Width::I8, -24), &[group])];
        let (rows, channels) = (GROUP, Channels::One);
        Span::of(&TransportMatrix {
            space,
            bands: space.bands(),
            rows,
            channels,
            quantum: -24,
            tile_rows: GROUP,
            tiles,
        })
    };
    // 100 of 2^-1 are below 2^6: 30 bits from 2^-24, 7 from 2^-1; no row is taken to span fewer than 27 once one is longer.
    assert_eq!(span(&[(1, 23, 100)]), Span(27));
    assert_eq!(span(&[(0, 0, 1), (1, 23, 100)]), Span(30));
    assert_eq!(span(&[(0, 0, 1), (1, 0, 100)]), Span(7));
}

/// What cannot be applied is refused, and leaves the state as it was.
#[test]
fn wrong_updates_are_refused() {
    let case = case(3, Width::I8);
    let columns = case.matrix.bands.columns() as u32;
    let mut response = Response::new(&case.matrix);
    let mut picture = vec![0.0; 3 * case.matrix.rows];
    let term = |column| Term { column, change: [1.0; 3] };
    for (resets, terms) in [
        (vec![], vec![term(columns)]),
        (vec![], vec![term(2), term(2)]),
        (vec![], vec![term(3), term(2)]),
        (vec![case.matrix.bands.count()], vec![]),
        (vec![1, 0], vec![]),
    ] {
        let update = Update { resets, moves: terms.clone(), terms, afresh: false };
        assert!(response.apply(&case.matrix, &update, Some(&mut picture)).is_err());
    }
    assert!(response.apply(&case.matrix, &Update::default(), Some(&mut picture[1..])).is_err());
    assert!(response.tiles().iter().flatten().all(|sums| sums.0 == [[0.0; GROUP]; 3]));
    let light = vec![[1.0; 3]; columns as usize - 1];
    assert!(multiply(&case.matrix, Span::of(&case.matrix), &[&light], &mut picture).is_err());
}

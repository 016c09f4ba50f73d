//! Integrals of one variable, to a tolerance: Gauss and Kronrod's 7 and 15 points, halved where they disagree.

/// Kronrod's points in [0, 1], with their weights; from the second on every other is Gauss's, with its weight (QUADPACK).
const POINTS: [(f64, f64, f64); 8] = [
    (0.991_455_371_120_812_6, 0.022_935_322_010_529_224, 0.0),
    (0.949_107_912_342_758_5, 0.063_092_092_629_978_56, 0.129_484_966_168_869_7),
    (0.864_864_423_359_769_1, 0.104_790_010_322_250_18, 0.0),
    (0.741_531_185_599_394_4, 0.140_653_259_715_525_92, 0.279_705_391_489_276_65),
    (0.586_087_235_467_691_1, 0.169_004_726_639_267_9, 0.0),
    (0.405_845_151_377_397_2, 0.190_350_578_064_785_4, 0.381_830_050_505_118_9),
    (0.207_784_955_007_898_47, 0.204_432_940_075_298_9, 0.0),
    (0.0, 0.209_482_141_084_727_82, 0.417_959_183_673_469_37),
];

/// Halvings of an interval: a kink in it has then lost what it weighs.
const DEPTH: usize = 24;

/// The integral of a function from `low` to `high`, to about `tolerance`.
pub(super) fn integral(function: &mut impl FnMut(f64) -> f64, low: f64, high: f64, tolerance: f64) -> f64 {
    halving(function, low, high, tolerance, DEPTH)
}

fn halving(function: &mut impl FnMut(f64) -> f64, low: f64, high: f64, tolerance: f64, depth: usize) -> f64 {
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    let (mut fine, mut coarse) = (0.0, 0.0);
    for (point, kronrod, gauss) in POINTS {
        let right = function(middle + half * point);
        let both = if point > 0.0 { right + function(middle - half * point) } else { right };
        fine += kronrod * both;
        coarse += gauss * both;
    }
    if half * (fine - coarse).abs() <= tolerance || depth == 0 {
        return half * fine;
    }
    // Each half may err as its share of the whole does at random: a root of 2 less, not 2.
    let finer = tolerance * std::f64::consts::FRAC_1_SQRT_2;
    halving(function, low, middle, finer, depth - 1) + halving(function, middle, high, finer, depth - 1)
}

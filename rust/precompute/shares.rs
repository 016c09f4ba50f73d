//! What rows take from nodes as whole numbers.

/// Weights are integers times 2^-12.
pub(super) const EXPONENT: i32 = -12;
pub(super) const WHOLE: u32 = 1 << -EXPONENT;
/// Nodes around a point that stand for it together.
pub(super) const TAKEN: usize = 4;

/// Shares as integers that sum to `wanted`: rounded down, and what is left goes to the largest remainders.
pub(super) fn in_whole_numbers(shares: &[(f64, u32)], wanted: u32) -> Vec<(u32, u16)> {
    let sum: f64 = shares.iter().map(|share| share.0).sum();
    if sum <= 0.0 {
        return Vec::new();
    }
    let exact: Vec<f64> = shares.iter().map(|share| share.0 / sum * f64::from(wanted)).collect();
    let mut whole: Vec<u32> = exact.iter().map(|x| *x as u32).collect();
    let mut order: Vec<usize> = (0..shares.len()).collect();
    order.sort_by(|&a, &b| (exact[b] - exact[b].floor()).total_cmp(&(exact[a] - exact[a].floor())));
    let left = wanted.saturating_sub(whole.iter().sum());
    order.iter().cycle().take(left as usize).for_each(|&k| whole[k] += 1);
    let pairs = shares.iter().zip(whole).map(|(share, weight)| (share.1, weight.min(u32::from(u16::MAX)) as u16));
    pairs.filter(|(_, weight)| *weight > 0).collect()
}

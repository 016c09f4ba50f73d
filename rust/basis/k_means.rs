//! Points in a few dimensions, gathered about centres: k-means, seeded on points that differ (k-means++).

use rayon::prelude::*;

use crate::sampling::jitter;

/// Dimensions: a random projection into so many keeps squares of distances to a fifth, the root of 2 / 48.
pub const DIMENSIONS: usize = 48;

/// One of them.
pub type Point = [f32; DIMENSIONS];

/// Points that one thread takes at a time.
const CHUNK: usize = 1024;

/// The cluster of each point, from 0 to fewer than `clusters`, after so many `rounds`; there are no more clusters than points
/// that differ. The same on any number of threads.
pub fn k_means(points: &[Point], clusters: usize, rounds: usize) -> Vec<u32> {
    let mut centres = seeds(points, clusters);
    let mut labels = nearest_of(points, &centres);
    for _ in 0..rounds {
        centres = means(points, &labels, centres.len());
        labels = nearest_of(points, &centres);
    }
    labels
}

/// Points that are far from each other: each is drawn with a chance that grows with its distance to those before.
fn seeds(points: &[Point], clusters: usize) -> Vec<Point> {
    let mut centres: Vec<Point> = points.first().copied().into_iter().collect();
    let mut distances = vec![f64::INFINITY; points.len()];
    while centres.len() < clusters.min(points.len()) {
        let last = centres[centres.len() - 1];
        let sums: Vec<f64> = distances
            .par_chunks_mut(CHUNK)
            .zip(points.par_chunks(CHUNK))
            .map(|(distances, points)| {
                for (distance, point) in distances.iter_mut().zip(points) {
                    *distance = distance.min(f64::from(square(point, &last)));
                }
                distances.iter().sum()
            })
            .collect();
        // Where all that are left lie on a centre, there are no more clusters.
        let Some(drawn) = draw(&distances, &sums, jitter(centres.len() as u64)[0]) else { break };
        centres.push(points[drawn]);
    }
    centres
}

/// The item at which the running sum passes a share of the whole: its chunk first, by the `sums` of chunks.
fn draw(items: &[f64], sums: &[f64], share: f64) -> Option<usize> {
    let mut left = share * sums.iter().sum::<f64>();
    let chunk = sums.iter().position(|sum| {
        let here = *sum > left;
        left -= if here { 0.0 } else { *sum };
        here
    });
    let last = || sums.iter().rposition(|&sum| sum > 0.0);
    let (first, mut found) = (chunk.or_else(last)? * CHUNK, None);
    for (k, &item) in items[first..].iter().take(CHUNK).enumerate() {
        if item > 0.0 {
            found = Some(first + k);
            if item > left {
                break;
            }
        }
        left -= item;
    }
    found
}

/// The mean of each cluster's points; of one without points the origin.
pub fn means(points: &[Point], labels: &[u32], clusters: usize) -> Vec<Point> {
    let (mut sums, mut counts) = (vec![[0.0f64; DIMENSIONS]; clusters], vec![0.0f64; clusters]);
    for (point, &label) in points.iter().zip(labels) {
        sums[label as usize].iter_mut().zip(point).for_each(|(sum, &x)| *sum += f64::from(x));
        counts[label as usize] += 1.0;
    }
    sums.iter().zip(counts).map(|(sums, count)| sums.map(|sum| (sum / count.max(1.0)) as f32)).collect()
}

fn nearest_of(points: &[Point], centres: &[Point]) -> Vec<u32> {
    points.par_iter().map(|point| nearest::<1>(point, centres)[0]).collect()
}

/// The `N` centres nearest to a point, the nearest first; where there are fewer, the first of all fills the rest.
pub fn nearest<const N: usize>(point: &Point, centres: &[Point]) -> [u32; N] {
    let mut found = [(f32::INFINITY, 0u32); N];
    for (number, centre) in centres.iter().enumerate() {
        let distance = square(point, centre);
        if distance < found[N - 1].0 {
            let place = found.partition_point(|seen| seen.0 <= distance);
            found[place..].rotate_right(1);
            found[place] = (distance, number as u32);
        }
    }
    found.map(|(_, number)| number)
}

/// The square of a distance, in lanes that vectorise.
fn square(a: &Point, b: &Point) -> f32 {
    let mut lanes = [0.0f32; 8];
    for (a, b) in a.as_chunks::<8>().0.iter().zip(b.as_chunks::<8>().0) {
        (0..8).for_each(|k| lanes[k] += (a[k] - b[k]) * (a[k] - b[k]));
    }
    (lanes[0] + lanes[4]) + (lanes[1] + lanes[5]) + ((lanes[2] + lanes[6]) + (lanes[3] + lanes[7]))
}

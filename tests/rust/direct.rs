//! The direct pass against what can be said without it: an even sky, and rays one by one.

use std::f64::consts::PI;
use std::sync::Arc;

use _core::basis::cubemap::{face_point, solid_angles};
use _core::basis::haar::Haar;
use _core::basis::{ColumnSpace, HARMONIC_FACE, HarmonicProjection};
use _core::precompute::{DirectPass, Lobes, respond};
use _core::scene::rays::Tracer;
use _core::scene::{Mesh, Points};

/// The response at points over some triangles to a sky, (6 size^2) texels, in columns of a space.
fn responses(points: Points, tracer: Tracer, space: ColumnSpace, edge_side: usize, v: &[[f64; 3]]) -> Vec<f64> {
    let (tracer, points) = (Arc::new(tracer), Arc::new(points));
    let pass = DirectPass::new(tracer, points, Arc::new(Lobes::default()), space, edge_side).unwrap();
    respond(&pass, v, &|_| Ok(())).unwrap().into_iter().map(|[red, ..]| f64::from(red)).collect()
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let length = a.iter().map(|x| x * x).sum::<f64>().sqrt();
    a.map(|x| x / length)
}

/// Where nothing is in the way B is the radiance of the sky: the integral of the cosine is pi, and solid angles are what they
/// are.
#[test]
fn an_open_point_receives_all_of_an_even_sky() {
    let ways = [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 1.0], [0.3, 0.9, -0.1]].map(unit);
    // One triangle, edge on, for which no texel is looked at.
    let mesh = Mesh::new(&[[1.0, 2.0, 3.0], [1.0 + 1e-6, 2.0, 3.0], [1.0, 2.0, 3.0 + 1e-6]], &[[0, 1, 2]]).unwrap();
    let size = 32;
    let haar = Haar::shared(size).unwrap().forward(&vec![[1.0; 3]; 6 * size * size]);
    let harmonics = HarmonicProjection::new(3, HARMONIC_FACE).unwrap();
    let harmonics = harmonics.forward(&vec![[1.0; 3]; 6 * HARMONIC_FACE * HARMONIC_FACE]);
    let spaces = [(ColumnSpace::haar(size).unwrap(), haar), (ColumnSpace::spherical_harmonics(3).unwrap(), harmonics)];
    for (space, v) in spaces {
        let origin = vec![mesh.normalised([1.0 - 1e-6; 3]); ways.len()];
        let points = Points { origin, normal: ways.map(|way| way.map(|x| x as f32)).to_vec(), horizon: Vec::new() };
        for (found, way) in responses(points, Tracer::new(&mesh), space, 0, &v).into_iter().zip(ways) {
            assert!((found - 1.0).abs() < 2e-3, "{space}, normal {way:?}: {found}");
        }
    }
}

/// Through texels that an edge runs through comes what rays into 64 x 64 parts of them find open.
#[test]
fn edge_texels_are_the_mean_of_what_is_open() {
    const PARTS: usize = 64;
    let size = 8;
    let wall = [[-0.7, -0.6, 1.0], [0.8, -0.5, 1.0], [0.1, 0.75, 1.0]];
    let mesh = Mesh::new(&wall, &[[0, 1, 2]]).unwrap();
    let tracer = Tracer::new(&mesh);
    let (origin, normal) = (mesh.normalised([0.0; 3]), unit([0.1, 0.4, 1.0]));
    let way = |face: usize, column: f64, row: f64| {
        unit(face_point(face, 2.0 * column / size as f64 - 1.0, 2.0 * row / size as f64 - 1.0))
    };
    let open = |way: [f64; 3]| !tracer.occluded(origin, way.map(|x| x as f32));
    let cosine = |way: [f64; 3]| (0..3).map(|k| way[k] * normal[k]).sum::<f64>().max(0.0);

    // Texels of the face of the wall whose centre has another answer than that of a neighbour.
    let (face, areas) = (4, solid_angles(size));
    let centre = |column: usize, row: usize| open(way(face, column as f64 + 0.5, row as f64 + 0.5));
    let mut sky = vec![[0f32; 3]; 6 * size * size];
    let (mut expected, mut edges) = (0.0, 0);
    for (row, column) in (0..size).flat_map(|row| (0..size).map(move |column| (row, column))) {
        let unlike = |c: usize, r: usize| c < size && r < size && centre(c, r) != centre(column, row);
        let near = [(column.wrapping_sub(1), row), (column + 1, row), (column, row.wrapping_sub(1)), (column, row + 1)];
        if !near.into_iter().any(|(c, r)| unlike(c, r)) {
            continue;
        }
        let part = |k: usize| (k as f64 + 0.5) / PARTS as f64;
        let parts =
            (0..PARTS * PARTS).map(|k| way(face, column as f64 + part(k % PARTS), row as f64 + part(k / PARTS)));
        let mean = parts.filter(|&way| open(way)).map(cosine).sum::<f64>() / (PARTS * PARTS) as f64;
        expected += mean * areas[row * size + column] / PI;
        sky[(face * size + row) * size + column] = [1.0; 3];
        edges += 1;
    }
    assert!(edges > 15);
    let v = Haar::shared(size).unwrap().forward(&sky);
    let points = Points { origin: vec![origin], normal: vec![normal.map(|x| x as f32)], horizon: Vec::new() };
    let found = responses(points, Tracer::new(&mesh), ColumnSpace::haar(size).unwrap(), 16, &v)[0];
    assert!((found / expected - 1.0).abs() < 0.008, "{found}, expected {expected} of {edges} texels");
}

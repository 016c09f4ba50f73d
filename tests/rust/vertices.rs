//! Receivers at vertices: which sides lie open whatever the winding, what is buried, and that corners lead to their rows.

use _core::scene::rays::Tracer;
use _core::scene::vertices::NONE;
use _core::scene::{Faces, Mesh, Shading, Surfaces, Vertices};
use proptest::prelude::*;

/// Corners of a cube of half a side `half` around a centre, two triangles a face, wound outwards; those whose bit is set in
/// `turned` the other way round.
fn cube(centre: [f64; 3], half: f64, turned: u32) -> Body {
    let corner =
        |k: usize| std::array::from_fn(|axis| centre[axis] + half * if k >> axis & 1 == 1 { 1.0 } else { -1.0 });
    let vertices = (0..8).map(corner).collect();
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let halves = faces.iter().flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]]);
    let wound = halves.enumerate().map(|(k, [a, b, c])| if turned >> k & 1 == 1 { [a, c, b] } else { [a, b, c] });
    (vertices, wound.collect())
}

/// Vertices and triangles.
type Body = (Vec<[f64; 3]>, Vec<[u32; 3]>);

fn joined(parts: &[Body]) -> Body {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for (own, corners) in parts {
        let start = vertices.len() as u32;
        vertices.extend(own);
        triangles.extend(corners.iter().map(|corners: &[u32; 3]| corners.map(|k| k + start)));
    }
    (vertices, triangles)
}

fn found(vertices: &[[f64; 3]], triangles: &[[u32; 3]], shading: Shading, normals: Option<&[[f32; 3]]>) -> Vertices {
    let mesh = Mesh::new(vertices, triangles).unwrap();
    let tracer = Tracer::new(&mesh);
    let material = vec![0; triangles.len()];
    let faces = Faces { triangles, material: &material, normals };
    let rows = Vertices::of_mesh(Surfaces { mesh: &mesh, tracer: &tracer }, faces, shading, &|| Ok(())).unwrap();
    // Each row a corner names lies where the corner does.
    for (triangle, sides) in rows.corners.iter().enumerate() {
        for (k, &row) in sides.iter().flatten().enumerate().filter(|(_, row)| **row != NONE) {
            let place = mesh.normalised(vertices[triangles[triangle][k % 3] as usize]).map(f64::from);
            let at = &rows.places[row as usize];
            assert!((0..3).all(|axis| (at.place[axis] - place[axis]).abs() < 1e-6));
            let side = if k < 3 { 1.0 } else { -1.0 };
            let face = mesh.normal(triangle);
            assert!((0..3).map(|axis| side * face[axis] * at.normal[axis]).sum::<f64>() > 0.0);
        }
    }
    rows
}

/// Whether all rows face away from a centre.
fn outwards(rows: &Vertices) -> bool {
    rows.places.iter().all(|at| (0..3).map(|k| at.place[k] * at.normal[k]).sum::<f64>() > 0.0)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_cube_has_its_outside_however_it_is_wound(turned in 0u32..4096) {
        let (vertices, triangles) = cube([0.0; 3], 1.0, turned);
        for shading in [Shading::Smooth, Shading::Flat] {
            let rows = found(&vertices, &triangles, shading, None);
            // Three faces meet in each corner, with creases between them.
            prop_assert_eq!(rows.len(), 24);
            prop_assert!(outwards(&rows) && !rows.buried.contains(&true));
        }
    }
}

#[test]
fn a_sheet_has_two_sides() {
    let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    let rows = found(&vertices, &[[0, 1, 2], [0, 2, 3]], Shading::Smooth, None);
    assert_eq!(rows.len(), 8);
    assert!(rows.corners.iter().flatten().flatten().all(|&row| row != NONE));
    assert_eq!(rows.places.iter().filter(|at| at.normal[2] > 0.0).count(), 4);
}

#[test]
fn what_lies_inside_something_else_is_buried_and_shows_its_neighbour() {
    // A post that stands in a block: its lower corners are inside.
    let block = cube([0.0; 3], 1.0, 0);
    let mut post = cube([0.0, 0.9, 0.0], 0.3, 0);
    post.0.iter_mut().for_each(|vertex| vertex[1] = if vertex[1] < 0.9 { 0.5 } else { 2.0 });
    let (vertices, triangles) = joined(&[block, post]);
    let rows = found(&vertices, &triangles, Shading::Flat, None);
    assert_eq!(rows.len(), 48);
    for (row, at) in rows.places.iter().enumerate() {
        let inside = rows.vertex[row] >= 8 && vertices[rows.vertex[row] as usize][1] < 1.0;
        assert_eq!(rows.buried[row], inside, "{:?}", at.place);
        assert_eq!(rows.points.normal[row] == [0.0; 3], inside);
        let shown = rows.shown[row] as usize;
        assert!(!rows.buried[shown] && (inside || shown == row));
        assert_eq!(rows.vertex[shown] >= 8, rows.vertex[row] >= 8);
    }
}

#[test]
fn a_buried_vertex_of_a_sheet_shows_its_own_side() {
    // A block on a sheet of 4 x 4 cells: what is under it is inside, and the other side of the sheet is not.
    let at = |k: u32| -2.0 + f64::from(k);
    let sheet: Vec<[f64; 3]> = (0..25).map(|k| [at(k % 5), 0.0, at(k / 5)]).collect();
    let cell = |k: u32| k / 4 * 5 + k % 4;
    let halves: Vec<[u32; 3]> = (0..16).map(cell).flat_map(|a| [[a, a + 5, a + 6], [a, a + 6, a + 1]]).collect();
    let (vertices, triangles) = joined(&[(sheet, halves), cube([0.0, 1.0, 0.0], 1.2, 0)]);
    let rows = found(&vertices, &triangles, Shading::Smooth, None);
    let under = (0..rows.len()).filter(|&row| rows.vertex[row] < 25 && rows.buried[row]);
    let mut count = 0;
    for row in under {
        let shown = rows.shown[row] as usize;
        assert!(rows.places[row].normal[1] * rows.places[shown].normal[1] > 0.0 && !rows.buried[shown]);
        count += 1;
    }
    // The nine in the middle, from above; from below too, as the block reaches through.
    assert_eq!(count, 18);
}

#[test]
fn a_round_body_has_one_row_a_vertex_and_the_normals_that_it_brings() {
    let (columns, lines) = (24, 12);
    let mut vertices = Vec::new();
    for line in 0..=lines {
        for column in 0..columns {
            let (a, b) = (
                std::f64::consts::PI * line as f64 / lines as f64,
                std::f64::consts::TAU * column as f64 / columns as f64,
            );
            // The poles are one place each.
            let ring = if line == 0 || line == lines { 0.0 } else { a.sin() };
            vertices.push([ring * b.cos(), a.cos(), ring * b.sin()]);
        }
    }
    let at = |line: usize, column: usize| (line * columns + column % columns) as u32;
    let mut triangles = Vec::new();
    for line in 0..lines {
        for column in 0..columns {
            let (a, b, c, d) = (at(line, column), at(line, column + 1), at(line + 1, column), at(line + 1, column + 1));
            if line > 0 {
                triangles.push([a, b, d]);
            }
            if line + 1 < lines {
                triangles.push([a, d, c]);
            }
        }
    }
    let distinct = columns * (lines - 1) + 2;
    let own = found(&vertices, &triangles, Shading::Smooth, None);
    assert_eq!(own.len(), distinct);
    let off = |rows: &Vertices| {
        let cosine = |row: usize| {
            let (place, normal) = (rows.places[row].place, rows.points.normal[row].map(f64::from));
            let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
            dot(place, normal) / dot(place, place).sqrt()
        };
        (0..rows.len()).map(|row| 1.0 - cosine(row)).fold(0.0, f64::max)
    };
    assert!(off(&own) < 0.01, "{}", off(&own));
    // Inwards or outwards, long or short: only the line counts.
    let brought: Vec<[f32; 3]> = vertices.iter().map(|v| v.map(|x| -3.0 * x as f32)).collect();
    let exact = found(&vertices, &triangles, Shading::Smooth, Some(&brought));
    assert_eq!(exact.len(), distinct);
    assert!(off(&exact) < 1e-6, "{}", off(&exact));
    assert!(found(&vertices, &triangles, Shading::Flat, None).len() > 3 * distinct);
}

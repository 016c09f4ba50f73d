//! Rays: every way of tracing them against brute force in f64, then the cases where ray tracers leak or hit themselves.

use _core::scene::rays::{Apex, FAN, Fan, Holes, LIFT, Octant, Opacity, Picture, Tracer, Walk, Wrap, fans, walk};
use _core::scene::{Mesh, Surfaces};
use proptest::prelude::*;

type Point = [f64; 3];

fn sub(a: Point, b: Point) -> Point {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Point, b: Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: Point) -> Point {
    a.map(|x| x / dot(a, a).sqrt())
}

fn wide(a: [f32; 3]) -> Point {
    a.map(f64::from)
}

fn narrow(a: Point) -> [f32; 3] {
    a.map(|x| x as f32)
}

/// SplitMix64: the same scenes on every machine.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In [-1, 1).
    fn number(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn point(&mut self) -> Point {
        std::array::from_fn(|_| self.number())
    }

    fn direction(&mut self) -> Point {
        loop {
            let p = self.point();
            if (0.01..1.0).contains(&dot(p, p)) {
                return unit(p);
            }
        }
    }
}

/// Vertices and triangles as a user gives them.
#[derive(Clone, Default)]
struct Soup {
    vertices: Vec<Point>,
    triangles: Vec<[u32; 3]>,
}

impl Soup {
    fn add(&mut self, corners: [Point; 3]) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(corners);
        self.triangles.push([first, first + 1, first + 2]);
    }

    /// Triangles of a given size at random places.
    fn random(count: usize, size: f64, dice: &mut Dice) -> Soup {
        let mut soup = Soup::default();
        for _ in 0..count {
            let at = dice.point();
            soup.add(std::array::from_fn(|_| {
                let step = dice.point();
                std::array::from_fn(|k| at[k] + size * step[k])
            }));
        }
        soup
    }

    /// The closed box [-1, 1]^3, its faces in n x n squares of two triangles: 12 n^2 triangles, 768 for n = 8.
    fn grid_box(n: usize) -> Soup {
        let mut soup = Soup::default();
        let at = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
        for axis in 0..3 {
            for side in [-1.0, 1.0] {
                for (i, j) in (0..n * n).map(|k| (k / n, k % n)) {
                    let corner = |di: usize, dj: usize| {
                        let mut p = [side; 3];
                        p[(axis + 1) % 3] = at(i + di);
                        p[(axis + 2) % 3] = at(j + dj);
                        p
                    };
                    soup.add([corner(0, 0), corner(1, 0), corner(1, 1)]);
                    soup.add([corner(0, 0), corner(1, 1), corner(0, 1)]);
                }
            }
        }
        soup
    }

    /// The unit sphere: an octahedron split into four, `levels` times.
    fn sphere(levels: usize) -> Soup {
        let mut faces: Vec<[Point; 3]> = Vec::new();
        for octant in 0..8 {
            let sign = |bit: usize| if octant >> bit & 1 == 1 { -1.0 } else { 1.0 };
            let axes = [[sign(0), 0.0, 0.0], [0.0, sign(1), 0.0], [0.0, 0.0, sign(2)]];
            faces.push(if sign(0) * sign(1) * sign(2) > 0.0 { axes } else { [axes[0], axes[2], axes[1]] });
        }
        let middle = |a: Point, b: Point| unit(std::array::from_fn(|k| a[k] + b[k]));
        for _ in 0..levels {
            let split = |[a, b, c]: [Point; 3]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            };
            faces = faces.into_iter().flat_map(split).collect();
        }
        let mut soup = Soup::default();
        faces.into_iter().for_each(|face| soup.add(face));
        soup
    }

    fn moved(&self, scale: f64, offset: Point) -> Soup {
        let vertices = self.vertices.iter().map(|v| std::array::from_fn(|k| scale * v[k] + offset[k])).collect();
        Soup { vertices, triangles: self.triangles.clone() }
    }

    fn mesh(&self) -> Mesh {
        Mesh::new(&self.vertices, &self.triangles).expect("a valid scene")
    }
}

/// Nearest hit of every triangle by Cramer's rule in f64, and whether an edge or the origin is too near for f32 to tell.
fn brute(mesh: &Mesh, origin: [f32; 3], direction: [f32; 3]) -> (Option<(usize, f64)>, bool) {
    const NEAR: f64 = 1e-5;
    let (o, d) = (wide(origin), wide(direction));
    let (mut best, mut doubtful): (Option<(usize, f64)>, bool) = (None, false);
    for (number, corners) in mesh.corners.iter().enumerate() {
        let [a, b, c] = corners.map(wide);
        let (e1, e2, s) = (sub(b, a), sub(c, a), sub(o, a));
        let n = cross(e1, e2);
        let slope = -dot(n, d);
        let longest = [e1, e2, sub(c, b)].iter().map(|e| dot(*e, *e)).fold(0.0, f64::max);
        // Seen nearly edge-on, the margin in weights grows without bound.
        let margin = NEAR * longest.sqrt().max(1.0) * longest.sqrt() / slope.abs();
        let t = dot(n, s) / slope;
        let m = cross(s, d);
        let (u, v) = (dot(e2, m) / slope, -dot(e1, m) / slope);
        let inside = u.min(v).min(1.0 - u - v);
        let far = NEAR / slope.abs() * dot(n, n).sqrt();
        doubtful |= slope.abs() < 1e-12 || inside.abs() < margin && t > -far || inside > -margin && t.abs() < far;
        if inside >= 0.0 && t > 0.0 && best.is_none_or(|(_, nearest)| t < nearest) {
            best = Some((number, t));
        }
    }
    (best, doubtful)
}

/// The 6 n^2 texel centres of a cubemap.
fn texel_centres(n: usize) -> Vec<[f32; 3]> {
    let at = |k: usize| (2 * k + 1) as f64 / n as f64 - 1.0;
    let faces = (0..6).flat_map(|face| (0..n * n).map(move |texel| (face, texel / n, texel % n)));
    faces
        .map(|(face, row, column)| {
            let (s, t) = (at(column), at(row));
            narrow(unit(match face {
                0 => [1.0, -t, -s],
                1 => [-1.0, -t, s],
                2 => [s, 1.0, t],
                3 => [s, -1.0, -t],
                4 => [s, -t, 1.0],
                _ => [-s, -t, -1.0],
            }))
        })
        .collect()
}

/// Every answer to "which of these rays from one point are blocked", in fans, one ray at a time, and portably: all equal.
fn blocked_all_ways(tracer: &Tracer, from: &Apex, directions: &[[f32; 3]]) -> Vec<bool> {
    let mut room = Walk::default();
    let mut blocked = vec![false; directions.len()];
    for (fan, places) in fans(directions) {
        let together = tracer.blocked(from, &fan, fan.all(), &mut room);
        let portable = walk::blocked_portable(tracer.wide(), from, &fan, fan.all(), &mut room);
        assert_eq!(together, portable, "the portable path");
        for (ray, &place) in places.iter().enumerate() {
            blocked[place] = together >> ray & 1 == 1;
            let alone = tracer.blocked(from, &fan, 1 << ray, &mut room);
            assert_eq!(alone, together & 1 << ray, "one ray at a time");
            let mut single = Fan::new(Octant::of(directions[place]));
            single.push(Octant::of(directions[place]).slopes(directions[place]));
            assert_eq!(tracer.blocked(from, &single, 1, &mut room) == 1, blocked[place], "a fan of its own");
        }
    }
    blocked
}

/// Holds every answer to rays from one point against brute force; how many of them were sure.
fn check_against_brute_force(mesh: &Mesh, tracer: &Tracer, from: &Apex, directions: &[[f32; 3]]) -> usize {
    let blocked = blocked_all_ways(tracer, from, directions);
    let sure = directions.iter().zip(blocked).filter(|&(&direction, blocked)| {
        let (expected, doubtful) = brute(mesh, from.origin, direction);
        assert!(doubtful || expected.is_some() == blocked, "from {from:?} towards {direction:?}");
        !doubtful
    });
    sure.count()
}

/// No normal: the point lies on no surface, and every direction counts.
fn free(origin: [f32; 3]) -> Apex {
    Apex { origin, normal: [0.0; 3] }
}

/// Counts rays from inside a closed mesh that get out, in fans and one by one.
fn leaks(tracer: &Tracer, origins: &[[f32; 3]], directions: &[[f32; 3]]) -> (usize, usize) {
    let (mut rays, mut lost) = (0, 0);
    let mut room = Walk::default();
    let fans = fans(directions);
    for &origin in origins {
        for (fan, _) in &fans {
            lost += (fan.all() & !tracer.blocked(&free(origin), fan, fan.all(), &mut room)).count_ones() as usize;
            rays += fan.len();
        }
        lost += directions.iter().step_by(7).filter(|&&direction| !tracer.occluded(origin, direction)).count();
    }
    (rays, lost)
}

/// Directions within a few degrees of one: what a block of texels looks like.
fn block_around(middle: Point, spread: f64, count: usize, dice: &mut Dice) -> Vec<[f32; 3]> {
    (0..count)
        .map(|_| {
            let step = dice.point();
            narrow(unit(std::array::from_fn(|k| middle[k] + spread * step[k])))
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn single_rays_agree_with_brute_force(seed: u64, count in 1usize..200, size in 0.01f64..1.0) {
        let mut dice = Dice(seed);
        let mesh = Soup::random(count, size, &mut dice).mesh();
        let tracer = Tracer::new(&mesh);
        for _ in 0..100 {
            let (origin, direction) = (narrow(dice.point()), narrow(dice.direction()));
            let (expected, doubtful) = brute(&mesh, origin, direction);
            if doubtful {
                continue;
            }
            prop_assert_eq!(tracer.occluded(origin, direction), expected.is_some());
            let hit = tracer.closest_hit(origin, direction);
            prop_assert_eq!(hit.map(|h| h.triangle), expected.map(|e| e.0));
            if let (Some(hit), Some((_, distance))) = (hit, expected) {
                prop_assert!((f64::from(hit.distance) - distance).abs() < 1e-4);
                let corners = mesh.corners[hit.triangle].map(wide);
                let [u, v] = hit.barycentric.map(f64::from);
                for k in 0..3 {
                    let surface = corners[0][k] * (1.0 - u - v) + corners[1][k] * u + corners[2][k] * v;
                    let ray = f64::from(origin[k]) + distance * f64::from(direction[k]);
                    prop_assert!((surface - ray).abs() < 1e-4, "{} {}", surface, ray);
                }
            }
        }
    }

    #[test]
    fn fans_agree_with_brute_force(
        seed: u64, count in 1usize..300, size in 0.01f64..1.0, rays in 1usize..=FAN, spread in 0.0f64..0.3,
    ) {
        let mut dice = Dice(seed);
        let mesh = Soup::random(count, size, &mut dice).mesh();
        let tracer = Tracer::new(&mesh);
        let directions = block_around(dice.direction(), spread, rays, &mut dice);
        for _ in 0..16 {
            let from = free(narrow(dice.point()));
            check_against_brute_force(&mesh, &tracer, &from, &directions);
        }
    }

    /// Directions all around, along axes and between them: wide fans, slopes of 0 and 1.
    #[test]
    fn odd_fans_agree_with_brute_force(seed: u64, count in 1usize..200) {
        let mut dice = Dice(seed);
        let mesh = Soup::random(100, 0.3, &mut dice).mesh();
        let tracer = Tracer::new(&mesh);
        let mut directions: Vec<[f32; 3]> = (0..count).map(|_| narrow(dice.direction())).collect();
        for k in (0..27).filter(|&k| k != 13) {
            directions.push(narrow(unit([k / 9, k / 3 % 3, k % 3].map(|x| x as f64 - 1.0))));
        }
        let from = free(narrow(dice.point()));
        check_against_brute_force(&mesh, &tracer, &from, &directions);
    }

    /// A ray that ends is blocked by what lies before its end, and by nothing else.
    #[test]
    fn segments_agree_with_brute_force(seed: u64, count in 1usize..300, size in 0.01f64..1.0, spread in 0.0f64..0.5) {
        let mut dice = Dice(seed);
        let mesh = Soup::random(count, size, &mut dice).mesh();
        let tracer = Tracer::new(&mesh);
        let from = free(narrow(dice.point()));
        let middle = dice.direction();
        let octant = Octant::of(narrow(middle));
        let ways: Vec<[f32; 3]> = block_around(middle, spread, 400, &mut dice)
            .into_iter().filter(|&d| Octant::of(d) == octant).take(FAN).collect();
        let mut fan = Fan::new(octant);
        let mut lengths = Vec::new();
        for &way in &ways {
            let nearest = brute(&mesh, from.origin, way).0.map_or(1.0, |hit| hit.1);
            // About the first hit, a little before it, a little behind it, anywhere.
            let length = nearest * [1.0 - 1e-3, 1.0 + 1e-3, 0.5, 2.0][(dice.next() % 4) as usize];
            lengths.push(length);
            fan.push_segment(octant.slopes(way), (length * wide(way)[octant.axes[2]].abs()) as f32);
        }
        let mut room = Walk::default();
        let blocked = tracer.blocked(&from, &fan, fan.all(), &mut room);
        prop_assert_eq!(blocked, walk::blocked_portable(tracer.wide(), &from, &fan, fan.all(), &mut room));
        for (ray, (&way, &length)) in ways.iter().zip(&lengths).enumerate() {
            prop_assert_eq!(tracer.blocked(&from, &fan, 1 << ray, &mut room), blocked & 1 << ray);
            let (expected, doubtful) = brute(&mesh, from.origin, way);
            let near = expected.is_some_and(|hit| (hit.1 - length).abs() < 1e-4);
            prop_assert!(doubtful || near || expected.is_some_and(|hit| hit.1 < length) == (blocked >> ray & 1 == 1));
        }
    }
}

/// Deterministic directions on regular meshes are where tracers leak.
#[test]
fn a_closed_box_does_not_leak() {
    let soup = Soup::grid_box(8);
    assert_eq!(soup.triangles.len(), 768);
    for offset in [[0.0; 3], [0.3, -0.7, 0.1]] {
        let mesh = soup.moved(1.0, offset).mesh();
        let tracer = Tracer::new(&mesh);
        // In the normalised scene the box is [-1/2, 1/2]^3 or [-1, 1]^3; origins stay just inside it.
        let half = mesh.scale;
        let inside = |p: Point| narrow(p.map(|x| x * half * (1.0 - 2.0 * LIFT)));
        let at = |k: usize| k as f64 / 4.0 - 1.0;
        let lattice: Vec<Point> = (0..9 * 9 * 9).map(|k| [at(k / 81), at(k / 9 % 9), at(k % 9)]).collect();
        let surface = |p: &&Point| p.iter().any(|x| x.abs() == 1.0);
        let vertices: Vec<[f32; 3]> = lattice.iter().filter(surface).map(|&p| inside(p)).collect();
        let within: Vec<[f32; 3]> = lattice.iter().filter(|p| !surface(p)).map(|&p| inside(p)).collect();

        let texels = texel_centres(8);
        let mut special: Vec<[f32; 3]> = Vec::new();
        for k in (0..27).filter(|&k| k != 13) {
            special.push(narrow(unit([k / 9, k / 3 % 3, k % 3].map(|x| x as f64 - 1.0))));
        }
        for (origins, directions) in
            [(&vertices, &texels), (&within, &texels), (&vertices, &special), (&within, &special)]
        {
            let (rays, lost) = leaks(&tracer, origins, directions);
            assert!(rays >= 8_000);
            assert_eq!(lost, 0, "of {rays}");
        }

        // From every lattice point inside exactly towards every vertex of the surface.
        let mut sum = 0;
        for &origin in &within {
            let towards: Vec<[f32; 3]> = vertices.iter().map(|&v| narrow(unit(sub(wide(v), wide(origin))))).collect();
            let (rays, lost) = leaks(&tracer, &[origin], &towards);
            assert_eq!(lost, 0, "of {rays} from {origin:?}");
            sum += rays;
        }
        assert!(sum > 100_000);
    }
}

#[test]
fn a_sphere_does_not_leak() {
    let mut dice = Dice(7);
    let soup = Soup::sphere(4);
    let mesh = soup.moved(1.0, [0.1, 0.2, 0.3]).mesh();
    let tracer = Tracer::new(&mesh);
    let origins: Vec<[f32; 3]> = (0..128).map(|_| narrow(dice.point().map(|x| 0.5 * mesh.scale * x))).collect();
    assert_eq!(leaks(&tracer, &origins, &texel_centres(16)).1, 0);
    // Towards its vertices and the middles of its edges, from the centre and from elsewhere.
    let corners: Vec<[Point; 3]> = mesh.corners.iter().map(|c| c.map(wide)).collect();
    for &origin in [[0.0; 3], [0.1, 0.0, 0.0]].iter().chain(&origins[..14]) {
        let towards = |p: Point| narrow(unit(sub(p, wide(origin))));
        let aims = corners.iter().flat_map(|c| [c[0], std::array::from_fn(|k| 0.5 * (c[1][k] + c[2][k]))]);
        let (rays, lost) = leaks(&tracer, &[origin], &aims.map(towards).collect::<Vec<_>>());
        assert_eq!(lost, 0, "of {rays}");
    }
}

/// Seen from outside, a convex mesh hides nothing from its own surface: no ray above the horizon may meet it, whatever
/// the user's units.
#[test]
fn a_convex_mesh_does_not_hit_itself() {
    for (scale, offset) in [(1e-5, 0.0), (1e-3, 1.0), (1.0, 0.0), (1.0, 1e3), (1e6, 0.0), (1e6, 1e6)] {
        let mut dice = Dice(11);
        let soup = Soup::sphere(4).moved(scale, [offset, -0.5 * offset, 0.3 * offset]);
        let mesh = soup.mesh();
        let tracer = Tracer::new(&mesh);
        let mut room = Walk::default();
        let directions = texel_centres(8);
        let mut rays = 0;
        for triangle in (0..mesh.corners.len()).step_by(17) {
            let normal = mesh.normal(triangle);
            let corners = mesh.corners[triangle].map(wide);
            let above: Vec<[f32; 3]> = directions.iter().copied().filter(|&d| dot(wide(d), normal) > 0.0).collect();
            let fans = fans(&above);
            for point in 0..64 {
                let weights: Point = std::array::from_fn(|_| dice.number().abs() + 1e-9);
                let sum: f64 = weights.iter().sum();
                let origin = narrow(std::array::from_fn(|k| {
                    (0..3).map(|c| weights[c] / sum * corners[c][k]).sum::<f64>() + LIFT * normal[k]
                }));
                // With the plane of its surface and without: neither needs the other.
                for from in [Apex { origin, normal: narrow(normal) }, free(origin)] {
                    let hit = fans.iter().any(|(fan, _)| tracer.blocked(&from, fan, fan.all(), &mut room) != 0);
                    assert!(!hit, "scale {scale}, offset {offset}, triangle {triangle}");
                }
                rays += above.len();
                let single = point == 0 && above.iter().step_by(5).any(|&d| tracer.occluded(origin, d));
                assert!(!single, "scale {scale}, offset {offset}, triangle {triangle}");
            }
        }
        assert!(rays >= 100_000);
    }
}

/// What a ray finds, and what a triangle is looked at from, lies off the surface: it does not hide the sky from itself.
#[test]
fn points_of_surfaces_are_lifted_off_them() {
    let mut dice = Dice(12);
    let mesh = Soup::sphere(4).moved(1.0, [0.3, -0.2, 0.1]).mesh();
    let tracer = Tracer::new(&mesh);
    let surfaces = Surfaces { mesh: &mesh, tracer: &tracer };
    let directions = texel_centres(8);
    let middle = mesh.normalised([0.3, -0.2, 0.1]).map(f64::from);
    for _ in 0..100 {
        let out = unit(dice.direction());
        let from = narrow(std::array::from_fn(|k| middle[k] + 2.0 * out[k]));
        let found = surfaces.meet(from, out.map(|x| -x)).unwrap();
        for point in [found, surfaces.side(found.triangle as usize, found.barycentric, false)] {
            let rise = dot(sub(point.origin, point.place), point.normal);
            let coordinate = point.place.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            assert!(rise >= LIFT * coordinate && rise < 1e-4, "{rise}");
            let above = directions.iter().copied().filter(|&d| dot(wide(d), point.normal) > 0.0);
            assert!(!above.step_by(7).any(|d| tracer.occluded(narrow(point.origin), d)));
        }
    }
}

/// Powers of two change nothing at all, other scales and offsets nothing but roundings.
#[test]
fn the_units_of_the_scene_do_not_matter() {
    let mut dice = Dice(3);
    let soup = Soup::random(500, 0.2, &mut dice);
    let mesh = soup.mesh();
    for scale in [2f64.powi(-17), 2f64.powi(20)] {
        let scaled = soup.moved(scale, [0.0; 3]).mesh();
        assert_eq!(scaled.corners, mesh.corners);
        assert_eq!(scaled.scale * scale, mesh.scale);
    }
    let tracer = Tracer::new(&mesh);
    for (scale, offset) in [(1e-5, 0.0), (1e6, 0.0), (1.0, 1e4), (1e6, -1e6)] {
        let other = soup.moved(scale, [offset; 3]).mesh();
        let moved = Tracer::new(&other);
        for _ in 0..2000 {
            let (origin, direction) = (dice.point(), narrow(dice.direction()));
            let here = mesh.normalised(origin);
            let there = other.normalised(origin.map(|x| scale * x + offset));
            let doubtful = brute(&mesh, here, direction).1;
            assert!(doubtful || tracer.occluded(here, direction) == moved.occluded(there, direction));
        }
    }
}

#[test]
fn duplicates_and_triangles_without_area_change_nothing() {
    let mut dice = Dice(5);
    let soup = Soup::random(200, 0.3, &mut dice);
    let mut doubled = soup.clone();
    for triangle in &soup.triangles[..50] {
        let [a, b, c] = triangle.map(|v| soup.vertices[v as usize]);
        doubled.add([a, b, c]);
        doubled.add([c, b, a]);
        doubled.add([a, a, b]);
        doubled.add([a, a, a]);
        // Its middle is exact, so that the three corners lie on one line to the bit.
        doubled.add([[0.0; 3], [0.25; 3], [0.5; 3]]);
    }
    let (mesh, more) = (soup.mesh(), doubled.mesh());
    assert_eq!(mesh.degenerate, 0);
    assert!(more.degenerate >= 100, "{}", more.degenerate);
    assert_eq!(more.corners.len() + more.degenerate, doubled.triangles.len());
    let (one, two) = (Tracer::new(&mesh), Tracer::new(&more));
    let directions = texel_centres(4);
    for _ in 0..64 {
        let from = free(narrow(dice.point()));
        let here = blocked_all_ways(&one, &from, &directions);
        let there = blocked_all_ways(&two, &from, &directions);
        for (k, &direction) in directions.iter().enumerate() {
            assert!(here[k] == there[k] || brute(&mesh, from.origin, direction).1);
        }
    }
}

/// Needles a thousand times as long as wide, and thinner: no hole and no shadow that brute force does not see.
#[test]
fn slivers_agree_with_brute_force() {
    let mut dice = Dice(9);
    let mut soup = Soup::default();
    for _ in 0..200 {
        let (a, b, side) = (dice.point(), dice.point(), dice.direction());
        let width = 10f64.powf(2.0 * dice.number() - 4.0);
        soup.add([a, b, std::array::from_fn(|k| b[k] + width * side[k])]);
    }
    let mesh = soup.mesh();
    let tracer = Tracer::new(&mesh);
    let mut sure = 0;
    for _ in 0..200 {
        let from = free(narrow(dice.point()));
        let directions = block_around(dice.direction(), 0.05, FAN, &mut dice);
        sure += check_against_brute_force(&mesh, &tracer, &from, &directions);
    }
    assert!(sure > 5000, "{sure}");
}

/// A scene of nothing but degenerate triangles is a scene in which everything is open.
#[test]
fn an_empty_tracer_blocks_nothing() {
    let mesh = Mesh::new(&[[0.0; 3], [1.0; 3]], &[[0, 1, 1]]).expect("accepted, and counted");
    assert_eq!((mesh.corners.len(), mesh.degenerate), (0, 1));
    let tracer = Tracer::new(&mesh);
    assert_eq!(blocked_all_ways(&tracer, &free([0.0; 3]), &[[0.0, 1.0, 0.0]]), [false]);
    assert!(!tracer.occluded([0.0; 3], [0.0, 1.0, 0.0]));
    assert_eq!(tracer.closest_hit([0.0; 3], [0.0, 1.0, 0.0]), None);
}

/// One triangle, many triangles in one place, and sizes that shrink by half each time: trees of unusual shape.
#[test]
fn unusual_trees_agree_with_brute_force() {
    let mut dice = Dice(13);
    let one = Soup::random(1, 0.5, &mut dice);
    let mut piled = Soup::default();
    (0..1000).for_each(|_| piled.add([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]));
    let mut shrinking = Soup::default();
    for k in 0..100 {
        let size = 0.5f64.powi(k % 20);
        shrinking.add([[size, 0.0, 0.0], [0.0, size, 0.0], [0.0, 0.0, size]]);
    }
    for soup in [one, piled, shrinking] {
        let mesh = soup.mesh();
        let tracer = Tracer::new(&mesh);
        let directions = texel_centres(4);
        for _ in 0..64 {
            let from = free(narrow(dice.point()));
            check_against_brute_force(&mesh, &tracer, &from, &directions);
        }
    }
}

#[test]
fn bad_meshes_are_refused_in_one_sentence() {
    let good = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let refusal = |vertices: &[Point], triangles: &[[u32; 3]]| {
        Mesh::new(vertices, triangles).err().expect("an error").to_string()
    };
    assert!(refusal(&good, &[]).contains("got none"));
    assert!(refusal(&good, &[[0, 1, 2], [0, 1, 3]]).contains("[0, 1, 3] in triangle 1"));
    for bad in [f64::NAN, f64::INFINITY] {
        let mut vertices = good;
        vertices[1][2] = bad;
        assert!(refusal(&vertices, &[[0, 1, 2]]).contains("at vertex 1"));
    }
    let huge = good.map(|v| v.map(|x| if x == 0.0 { -1.7e308 } else { 1.7e308 }));
    assert!(refusal(&huge, &[[0, 1, 2]]).contains("finite, normal size"));
}

/// A vertex that no triangle uses must not shrink the scene.
#[test]
fn stray_vertices_do_not_count() {
    let vertices = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1e9; 3]];
    let mesh = Mesh::new(&vertices, &[[0, 1, 2]]).expect("a valid scene");
    assert_eq!(mesh.scale, 1.0);
    assert_eq!(mesh.centre, [0.5, 0.5, 0.0]);
    assert_eq!(mesh.normal(0), [0.0, 0.0, 1.0]);
}

/// Opacities of all triangles by one picture, a checker of 4 x 4 texels over each.
fn with_holes(soup: &Soup, mesh: &Mesh, factor: f32, cutoff: Option<f32>, checker: bool) -> Tracer {
    let values = (0..16).map(|k| if (k / 4 + k % 4) % 2 == 0 { 1.0 } else { 0.0 }).collect();
    let picture = checker.then(|| Picture::new(values, 4, [Wrap::Repeat; 2], true).expect("a picture"));
    let opacity = Opacity { factor, cutoff, picture };
    let count = soup.vertices.len();
    let uv: Vec<[f32; 2]> = (0..count).map(|k| [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]][k % 3]).collect();
    let material = vec![0; soup.triangles.len()];
    let holes = Holes::new(mesh, &soup.triangles, &material, vec![Some(opacity)], &uv, &vec![1.0; count]);
    Tracer::with_holes(mesh, holes.expect("holes"))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// What is cut out is cut out for fans as for single rays, up to rays that pass along the border of a hole.
    #[test]
    fn holes_are_the_same_for_fans_and_single_rays(seed: u64, count in 1usize..120) {
        let mut dice = Dice(seed);
        let soup = Soup::random(count, 0.6, &mut dice);
        let mesh = soup.mesh();
        let (whole, tracer) = (Tracer::new(&mesh), with_holes(&soup, &mesh, 1.0, Some(0.5), true));
        let (mut room, mut unlike, mut passed, mut rays) = (Walk::default(), 0, 0, 0);
        for _ in 0..40 {
            let origin = narrow(dice.point());
            let directions: Vec<[f32; 3]> = (0..64).map(|_| narrow(dice.direction())).collect();
            for (fan, places) in fans(&directions) {
                let blocked = tracer.blocked(&Apex { origin, normal: [0.0; 3] }, &fan, fan.all(), &mut room);
                for (ray, &place) in places.iter().enumerate() {
                    let stopped = tracer.occluded(origin, directions[place]);
                    unlike += usize::from(stopped != (blocked >> ray & 1 == 1));
                    passed += usize::from(!stopped && whole.occluded(origin, directions[place]));
                    prop_assert!(!stopped || whole.occluded(origin, directions[place]));
                    prop_assert_eq!(stopped, tracer.closest_hit(origin, directions[place]).is_some());
                    rays += 1;
                }
                prop_assert_eq!(room.thin, 0);
            }
        }
        prop_assert!(200 * unlike <= rays, "{unlike} of {rays}");
        prop_assert!(count < 60 || passed > 0);
    }
}

/// A thin surface stops its share of rays, the same ray always, and says of all of them that they met it.
#[test]
fn thin_surfaces_stop_a_share() {
    let mut soup = Soup::default();
    soup.add([[-40.0, -40.0, 1.0], [40.0, -40.0, 1.0], [0.0, 60.0, 1.0]]);
    let mesh = soup.mesh();
    let tracer = with_holes(&soup, &mesh, 0.3, None, false);
    let (mut dice, mut room) = (Dice(3), Walk::default());
    let (mut by_fans, mut singles, mut rays) = (0, 0, 0);
    for _ in 0..200 {
        let origin = mesh.normalised([0.2 * dice.number(), 0.2 * dice.number(), 0.0]);
        let directions: Vec<[f32; 3]> =
            (0..64).map(|_| narrow(unit([0.3 * dice.number(), 0.3 * dice.number(), 1.0]))).collect();
        for (fan, places) in fans(&directions) {
            let from = Apex { origin, normal: [0.0; 3] };
            let blocked = tracer.blocked(&from, &fan, fan.all(), &mut room);
            assert_eq!(room.thin, fan.all());
            assert_eq!(blocked, tracer.blocked(&from, &fan, fan.all(), &mut room));
            by_fans += blocked.count_ones();
            rays += places.len() as u32;
        }
        singles += directions.iter().filter(|&&way| tracer.occluded(origin, way)).count() as u32;
    }
    // Of 12,800 rays four standard errors are 1.6 %.
    for stopped in [by_fans, singles] {
        assert!((f64::from(stopped) / f64::from(rays) - 0.3).abs() < 0.016, "{stopped} of {rays}");
    }
}

/// What lies far beyond what the eye is near keeps neither its place nor its scale; without the eye it does.
#[test]
fn what_is_far_does_not_count_near_the_eye() {
    let mut soup = Soup::sphere(2);
    let near = soup.mesh();
    soup.add([[1e5, 0.0, 0.0], [1e5 + 1.0, 0.0, 0.0], [1e5, 1.0, 0.0]]);
    let eye = Some([3.0, 1.0, 0.0]);
    let mesh = Mesh::seen(&soup.vertices, &soup.triangles, eye).expect("a mesh");
    assert_eq!((mesh.centre, mesh.scale, mesh.extent()), (near.centre, near.scale, near.extent()));
    assert_eq!(mesh.corners[..near.corners.len()], near.corners[..]);
    assert!(soup.mesh().scale < 1e-4);
    // Its own points are lifted as far as their coordinates are rough, and rays meet it where it is.
    let last = mesh.corners.len() - 1;
    assert!(mesh.lift(last) > 1e4 * LIFT && mesh.lift(0) == LIFT);
    let hit = Tracer::new(&mesh).closest_hit(mesh.normalised([1e5 + 0.2, 0.2, 50.0]), [0.0, 0.0, -1.0]);
    assert_eq!(hit.map(|hit| hit.triangle), Some(last));
    // A scene that reaches as far everywhere stays whole.
    let spread = Soup::random(200, 0.1, &mut Dice(5));
    let whole = Mesh::seen(&spread.vertices, &spread.triangles, Some([0.0; 3])).expect("a mesh");
    assert_eq!((whole.centre, whole.scale), (spread.mesh().centre, spread.mesh().scale));
}

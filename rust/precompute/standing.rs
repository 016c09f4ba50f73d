//! Up to 64 receivers side by side: what each makes of one point of a surface, in lanes of 32-bit floats.

// Loops over lanes go by index: closures (`map`, iterators) do not inherit the caller's instruction set, and every operation
// inside them would become a call.
#![allow(clippy::needless_range_loop)]

use crate::brdf::family::lookup::Angles;
use crate::scene::rays::FAN;

/// Where light is gathered.
#[derive(Clone, Copy, Debug)]
pub struct Receiver {
    /// Off its surface.
    pub origin: [f32; 3],
    /// Unit normal that cosines are taken to.
    pub normal: [f32; 3],
    /// That of the triangle: nothing below its horizon is seen either.
    pub rise: [f32; 3],
    /// Unit vector to the eye.
    pub eye: [f64; 3],
}

/// One number for each receiver.
pub type Lanes = [f32; FAN];

/// Receivers, axis by axis.
pub struct Standing {
    place: [Lanes; 3],
    normal: [Lanes; 3],
    eye: [Lanes; 3],
    cos_o: Lanes,
}

/// What each receiver makes of one point.
pub struct Met {
    /// Area over the square of the distance times both cosines; 0 where one is not above the horizon.
    pub share: Lanes,
    /// The directions, for lobes.
    towards: [Lanes; 3],
    /// Their cosines to the normal.
    cos_i: Lanes,
}

/// As `f32::max` of what is no NaN, in one instruction.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The square of a distance, as lanes have it.
#[inline(always)]
pub fn square(point: [f32; 3], from: [f32; 3]) -> f32 {
    let (ax, ay, az) = (point[0] - from[0], point[1] - from[1], point[2] - from[2]);
    ax * ax + ay * ay + az * az
}

impl Default for Met {
    fn default() -> Met {
        Met { share: [0.0; FAN], towards: [[0.0; FAN]; 3], cos_i: [0.0; FAN] }
    }
}

impl Standing {
    /// Of up to 64 receivers; places that are left over see nothing.
    pub fn of(receivers: &[Receiver]) -> Standing {
        let lanes = |of: &dyn Fn(&Receiver) -> f32| {
            let mut lanes = [0.0; FAN];
            lanes.iter_mut().zip(receivers).for_each(|(lane, receiver)| *lane = of(receiver));
            lanes
        };
        let axes = |of: &dyn Fn(&Receiver, usize) -> f32| [0, 1, 2].map(|k| lanes(&|receiver| of(receiver, k)));
        Standing {
            place: axes(&|receiver, k| receiver.origin[k]),
            normal: axes(&|receiver, k| receiver.normal[k]),
            eye: axes(&|receiver, k| receiver.eye[k] as f32),
            cos_o: lanes(&|receiver| (0..3).map(|k| receiver.normal[k] * receiver.eye[k] as f32).sum()),
        }
    }

    /// Which receivers face a point that faces them, one bit each, and the squares of their distances.
    #[inline(always)]
    pub fn facing(&self, point: [f32; 3], normal: [f32; 3], squares: &mut Lanes) -> u64 {
        let ([x, y, z], [nx, ny, nz]) = (&self.place, &self.normal);
        let mut faces = [0u8; FAN];
        for lane in 0..FAN {
            let (ax, ay, az) = (point[0] - x[lane], point[1] - y[lane], point[2] - z[lane]);
            let up = ax * nx[lane] + ay * ny[lane] + az * nz[lane];
            let down = ax * normal[0] + ay * normal[1] + az * normal[2];
            squares[lane] = ax * ax + ay * ay + az * az;
            faces[lane] = u8::from(up > 0.0) & u8::from(down < 0.0);
        }
        let mut mask = 0;
        for lane in 0..FAN {
            mask |= u64::from(faces[lane]) << lane;
        }
        mask
    }

    /// What all receivers make of a point, as so much of the surface as `parts` say.
    #[inline(always)]
    pub fn meet(&self, point: [f32; 3], normal: [f32; 3], parts: &Lanes, met: &mut Met) {
        let ([x, y, z], [nx, ny, nz]) = (&self.place, &self.normal);
        for lane in 0..FAN {
            let (ax, ay, az) = (point[0] - x[lane], point[1] - y[lane], point[2] - z[lane]);
            let square = larger(ax * ax + ay * ay + az * az, f32::MIN_POSITIVE);
            let inverse = 1.0 / square.sqrt();
            let (wx, wy, wz) = (ax * inverse, ay * inverse, az * inverse);
            let cos_i = wx * nx[lane] + wy * ny[lane] + wz * nz[lane];
            let down = -(wx * normal[0] + wy * normal[1] + wz * normal[2]);
            let share = parts[lane] / larger(square, parts[lane]);
            met.share[lane] = share * larger(cos_i, 0.0) * larger(down, 0.0);
            met.cos_i[lane] = cos_i;
            met.towards[0][lane] = wx;
            met.towards[1][lane] = wy;
            met.towards[2][lane] = wz;
        }
    }

    /// The angles of a receiver's pair of directions, the eye above the horizon.
    #[inline(always)]
    pub fn angles(&self, met: &Met, lane: usize) -> Angles {
        let (cos_i, cos_o) = (met.cos_i[lane], self.cos_o[lane]);
        let (nx, ny, nz) = (self.normal[0][lane], self.normal[1][lane], self.normal[2][lane]);
        let (ex, ey, ez) = (self.eye[0][lane], self.eye[1][lane], self.eye[2][lane]);
        let (wx, wy, wz) = (met.towards[0][lane], met.towards[1][lane], met.towards[2][lane]);
        let (along, sx, sy, sz) = (cos_i + cos_o, wx + ex, wy + ey, wz + ez);
        // What of the sum lies across the normal, and of the light across the mirror direction: differences that keep digits.
        let (ax, ay, az) = (sx - along * nx, sy - along * ny, sz - along * nz);
        let twice = 2.0 * cos_o;
        let (bx, by, bz) = (twice * nx - sx, twice * ny - sy, twice * nz - sz);
        let tan_h2 = (ax * ax + ay * ay + az * az) / (along * along);
        let length = (sx * sx + sy * sy + sz * sz).sqrt();
        Angles {
            cos_i,
            cos_o,
            cos_h2: 1.0 / (1.0 + tan_h2),
            tan_h2,
            cos_d: (sx * ex + sy * ey + sz * ez) / length,
            off_mirror: 0.5 * (bx * bx + by * by + bz * bz),
        }
    }

    /// Whether the eye of a receiver is above its horizon.
    #[inline(always)]
    pub fn is_seen(&self, lane: usize) -> bool {
        self.cos_o[lane] > 0.0
    }

    /// The same pair as vectors: to the point, to the eye, and the normal.
    pub fn directions(&self, met: &Met, lane: usize) -> [[f64; 3]; 3] {
        [&met.towards, &self.eye, &self.normal].map(|axes| axes.each_ref().map(|axis| f64::from(axis[lane])))
    }
}

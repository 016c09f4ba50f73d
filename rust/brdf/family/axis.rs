//! The angles at which the functions of a family are kept, by 1 - cos delta, which is from 0 to 1.

use std::f64::consts::FRAC_PI_2;

/// Angles of the logarithmic axis: lines between them are within 3e-4 of the peak of the widest lobe, Cook and Torrance's at 2,
/// and within 1e-5 of a narrow one's.
const NODES: usize = 1024;
/// Angles of the paper's axis, which it does not say; more change nothing.
const EVEN: usize = 400;
/// How far from 0 and 1 the paper keeps Lafortune's cosines.
const SHORT: f64 = 1e-3;

/// Angles in ascending order.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    kind: Kind,
    /// 1 - cos delta of each.
    falls: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    /// Even in ln(1 + (1 - cos delta) / width): dense where the narrowest lobe is, and from the normal to the horizon.
    Logarithmic { width: f64 },
    /// Even in delta.
    Angles,
    /// Even in cos delta.
    Cosines,
}

/// An angle at which a family is held against what it stands for.
pub(super) struct Probe {
    /// 1 - cos delta.
    pub fall: f64,
    /// sin delta cos delta times the angle around it.
    pub energy: f64,
    /// The angle around it.
    pub angle: f64,
}

/// delta of 1 - cos delta.
fn angle(fall: f64) -> f64 {
    2.0 * (0.5 * fall).sqrt().asin()
}

impl Axis {
    /// Dense from `width` down.
    pub fn logarithmic(width: f64) -> Axis {
        let step = (1.0 / width).ln_1p() / (NODES - 1) as f64;
        let mut falls: Vec<f64> = (0..NODES).map(|k| width * (step * k as f64).exp_m1()).collect();
        falls[NODES - 1] = 1.0;
        Axis { kind: Kind::Logarithmic { width }, falls }
    }

    /// The paper's: angles spread evenly, or their cosines.
    pub fn even(cosines: bool) -> Axis {
        let share = |k: usize| k as f64 / (EVEN - 1) as f64;
        if cosines {
            let falls = (0..EVEN).map(|k| SHORT + (1.0 - 2.0 * SHORT) * share(k)).collect();
            return Axis { kind: Kind::Cosines, falls };
        }
        let fall = |k: usize| 2.0 * (0.5 * FRAC_PI_2 * share(k)).sin().powi(2);
        Axis { kind: Kind::Angles, falls: (0..EVEN).map(fall).collect() }
    }

    /// 1 - cos delta of each angle.
    pub fn falls(&self) -> &[f64] {
        &self.falls
    }

    /// The angle below one, and the share of the way to the next.
    pub fn locate(&self, fall: f64) -> (usize, f64) {
        let last = self.falls.len() - 1;
        let at = match self.kind {
            Kind::Logarithmic { width } => (fall / width).ln_1p() / (1.0 / width).ln_1p(),
            Kind::Angles => angle(fall) / FRAC_PI_2,
            Kind::Cosines => (fall - SHORT) / (1.0 - 2.0 * SHORT),
        };
        let at = (at * last as f64).clamp(0.0, last as f64);
        let node = (at as usize).min(last - 1);
        (node, at - node as f64)
    }

    /// Weights of the angles under (sin delta cos delta)^power d delta.
    pub fn weights(&self, power: f64) -> Vec<f64> {
        around(&self.falls).map(|(angle, middle)| (0.5 * (2.0 * middle).sin()).powf(power) * angle).collect()
    }

    /// Where families are measured: ours at its angles and between them, the paper's at its own.
    pub fn probes(&self) -> Vec<Probe> {
        let mut falls = self.falls.clone();
        if matches!(self.kind, Kind::Logarithmic { .. }) {
            falls.extend(self.falls.windows(2).map(|pair| 0.5 * (pair[0] + pair[1])));
            falls.sort_by(f64::total_cmp);
        }
        let probe = |(fall, (angle, middle)): (&f64, (f64, f64))| Probe {
            fall: *fall,
            energy: 0.5 * (2.0 * middle).sin() * angle,
            angle,
        };
        falls.iter().zip(around(&falls)).map(probe).collect()
    }
}

/// How wide the part of the axis around each angle is, and its middle, which is never at the normal or the horizon.
fn around(falls: &[f64]) -> impl Iterator<Item = (f64, f64)> + use<> {
    let angles: Vec<f64> = falls.iter().map(|&fall| angle(fall)).collect();
    let last = angles.len() - 1;
    let border =
        move |k: usize| if k == 0 || k > last { angles[k.min(last)] } else { 0.5 * (angles[k - 1] + angles[k]) };
    (0..=last).map(move |k| (border(k + 1) - border(k), 0.5 * (border(k + 1) + border(k))))
}

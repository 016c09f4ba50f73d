//! What is edited of a model: the factor f_E of the half vector that its parameter acts on.
//!
//! Angles are given as 1 - cos delta, which keeps its digits in narrow lobes. Of a model of the half vector delta is its
//! angle to the normal; of Lafortune's, the angle whose cosine is the base of the power (Nguyen 2010, section 4).

use std::f64::consts::PI;
use std::sync::Arc;

use crate::brdf::direction::{Direction, Half, above, dot, mirrored};
use crate::brdf::range::within;
use crate::brdf::{AshikhminShirley, BlinnPhong, Brdf, CookTorrance, Fresnel, Ward, WardDuer, phong};
use crate::error::{Error, Result};

/// A model with one parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// f_F = 1.
    BlinnPhong,
    /// f_F = 1 / sqrt(n.wi n.wo).
    Ward,
    /// f_F = 1 / (n.wi n.wo).
    WardDuer,
    /// f_F = 1.
    Lafortune,
    /// f_F = G F / (4 n.wi n.wo).
    CookTorrance,
    /// f_F = F / (h.wo max(n.wi, n.wo)).
    AshikhminShirley,
}

/// All of them, by name.
pub const MODELS: [(&str, Model); 6] = [
    ("blinn-phong", Model::BlinnPhong),
    ("ward", Model::Ward),
    ("ward-duer", Model::WardDuer),
    ("lafortune", Model::Lafortune),
    ("cook-torrance", Model::CookTorrance),
    ("ashikhmin-shirley", Model::AshikhminShirley),
];

/// f_E of a model, in one of two forms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edited {
    /// Whose it is.
    pub model: Model,
    /// As Nguyen 2010 prints it (table 4), in the place of the form under which the model reflects no more than all light:
    /// Blinn and Phong's reflects up to four times as much, Cook and Torrance's has cos^4 delta in the other factor.
    pub printed: bool,
    /// What facets reflect at normal incidence, and more at others as Schlick has it: it stands still. 1: mirrors.
    pub f0: f64,
}

impl Edited {
    /// By the model's name.
    pub fn named(name: &str, printed: bool) -> Result<Edited> {
        let found = MODELS.iter().find(|(known, _)| *known == name);
        let model = found.map(|&(_, model)| model).ok_or_else(|| {
            let names = MODELS.map(|(name, _)| name).join(", ");
            Error::input(format!("expected a model of {names}, got {name:?}"))
        })?;
        Ok(Edited { model, printed, f0: 1.0 })
    }

    /// With facets that reflect so much at normal incidence; Lafortune's model has none.
    pub fn with_facets(self, f0: f64) -> Result<Edited> {
        if self.model == Model::Lafortune && f0 != 1.0 {
            return Err(Error::input("expected f0 of a model of the half vector: lafortune has no facets"));
        }
        Ok(Edited { f0: within("f0", f0, 0.0, 1.0)?, ..self })
    }

    /// The model of one parameter, with facets that are mirrors.
    pub fn model(self, gamma: f64) -> Result<Arc<dyn Brdf>> {
        Ok(match self.model {
            Model::BlinnPhong => Arc::new(BlinnPhong::new(gamma)?),
            Model::Ward => Arc::new(Ward::new([gamma; 2])?),
            Model::WardDuer => Arc::new(WardDuer::new([gamma; 2])?),
            Model::Lafortune => Arc::new(phong(gamma)?),
            Model::CookTorrance => Arc::new(CookTorrance::new(gamma, Fresnel::None)?),
            Model::AshikhminShirley => Arc::new(AshikhminShirley::new([gamma; 2], Fresnel::None)?),
        })
    }

    /// Whether the parameter is an exponent; else it is a roughness.
    fn is_power(self) -> bool {
        matches!(self.model, Model::BlinnPhong | Model::Lafortune | Model::AshikhminShirley)
    }

    /// Refuses a range that is none, or leaves the models' own.
    pub fn check(self, [low, high]: [f64; 2]) -> Result<()> {
        let [least, most] = if self.is_power() { [1.0, 1e4] } else { [0.005, 10.0] };
        within("gamma", low, least, most)?;
        within("gamma", high, least, most)?;
        match low < high {
            true => Ok(()),
            false => Err(Error::input(format!("expected a range of gamma that grows, got {low} to {high}"))),
        }
    }

    /// About 1 - cos delta at which the narrowest lobe of a range has fallen to 1 / e.
    pub(super) fn width(self, [low, high]: [f64; 2]) -> f64 {
        if self.is_power() { 1.0 / high } else { (0.5 * low * low).min(1.0) }
    }

    /// Where f_E is asked for two directions, as 1 - cos delta, and f_F there; None where the model is 0. Lafortune's
    /// coefficients are Phong's.
    pub fn fixed(self, wi: Direction, wo: Direction) -> Option<(f64, f64)> {
        if self.model == Model::Lafortune {
            let apart: Direction = std::array::from_fn(|k| mirrored(wo)[k] - wi[k]);
            let fall = 0.5 * dot(apart, apart);
            return (above(wi) && above(wo) && fall < 1.0).then_some((fall, 1.0));
        }
        let half = Half::between(wi, wo)?;
        // 1 - cos, without the subtraction: tan² = (1 - cos) (1 + cos) / cos².
        let tangent2 = half.slope[0] * half.slope[0] + half.slope[1] * half.slope[1];
        let cosine2 = 1.0 / (1.0 + tangent2);
        let fall = tangent2 * cosine2 / (1.0 + cosine2.sqrt());
        let (both, most) = (half.cos_i * half.cos_o, half.cos_i.max(half.cos_o));
        let fixed = match self.model {
            Model::BlinnPhong | Model::Lafortune => 1.0,
            Model::Ward => 1.0 / both.sqrt(),
            Model::WardDuer => 1.0 / both,
            Model::AshikhminShirley => 1.0 / (half.cos_d * most),
            Model::CookTorrance => {
                let seen = (2.0 * half.cos_h / (half.cos_d * most)).min(1.0 / both);
                if self.printed { seen / (cosine2 * cosine2) } else { 0.25 * seen }
            }
        };
        let grazing = 1.0 - half.cos_d;
        let fresnel = self.f0 + (1.0 - self.f0) * grazing.powi(5);
        Some((fall.min(1.0), fresnel * fixed))
    }

    /// What the exponent of f_E is a multiple of: ln cos delta, or tan² delta. Infinite at the horizon.
    pub fn abscissa(self, fall: f64) -> f64 {
        if self.is_power() {
            return (-fall).ln_1p();
        }
        let cosine = 1.0 - fall;
        fall * (2.0 - fall) / (cosine * cosine)
    }

    /// f_E of one parameter, over the abscissa.
    pub fn at(self, gamma: f64) -> Curve {
        let gaussian = 1.0 / (PI * gamma * gamma);
        let (scale, fourth) = match (self.model, self.printed) {
            (Model::BlinnPhong, false) => {
                ((gamma + 2.0) * (gamma + 4.0) / (8.0 * PI * ((-0.5 * gamma).exp2() + gamma)), false)
            }
            (Model::BlinnPhong, true) | (Model::Lafortune, _) => ((gamma + 2.0) / (2.0 * PI), false),
            (Model::AshikhminShirley, _) => ((gamma + 1.0) / (8.0 * PI), false),
            (Model::Ward | Model::WardDuer, _) => (0.25 * gaussian, false),
            (Model::CookTorrance, printed) => (gaussian, !printed),
        };
        Curve { scale, rate: if self.is_power() { gamma } else { -1.0 / (gamma * gamma) }, fourth }
    }

    /// f_E.
    pub fn value(self, gamma: f64, fall: f64) -> f64 {
        self.at(gamma).value(self.abscissa(fall))
    }
}

/// f_E of one parameter: an exponential of the abscissa, for Cook and Torrance over cos^4 delta.
#[derive(Clone, Copy, Debug)]
pub struct Curve {
    scale: f64,
    rate: f64,
    fourth: bool,
}

impl Curve {
    /// f_E where the abscissa is x; at the horizon all lobes have ended.
    #[inline(always)]
    pub fn value(self, x: f64) -> f64 {
        if x.is_infinite() {
            return 0.0;
        }
        // 1 / cos² = 1 + tan².
        let over = if self.fourth { (1.0 + x) * (1.0 + x) } else { 1.0 };
        self.scale * over * (self.rate * x).exp()
    }
}

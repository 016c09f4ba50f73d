//! Models by numbers and parameters, as files hold them (`transport/file/FORMAT.md`).

use std::sync::Arc;

use crate::error::{Error, Result};

use super::{
    AshikhminShirley, Beckmann, BlinnPhong, Brdf, CookTorrance, Fresnel, Ggx, Lafortune, Lambert, Ward, WardDuer, phong,
};

/// A parameter that is not given.
const NOTHING: f64 = -1.0;

/// A model, and what it is made from.
#[derive(Clone, Debug)]
pub struct Stored {
    /// Its number: 1 Lambert, 2 Phong, 3 Blinn-Phong, 4 Ward, 5 Ward-Duer, 6 Lafortune, 7 Cook-Torrance, 8 Beckmann, 9 GGX,
    /// 10 Ashikhmin-Shirley.
    pub kind: u32,
    /// In the order of its Python class, then any.
    pub parameters: Vec<f64>,
    /// What they make.
    pub model: Arc<dyn Brdf>,
}

impl Stored {
    /// Refuses numbers of no model, and parameters that its constructor refuses.
    pub fn new(kind: u32, parameters: Vec<f64>) -> Result<Stored> {
        Ok(Stored { kind, model: model(kind, &parameters)?, parameters })
    }
}

fn model(kind: u32, parameters: &[f64]) -> Result<Arc<dyn Brdf>> {
    let &[a, b, c, d, e, ..] = parameters else {
        return Err(Error::input(format!("expected five parameters or more of a model, got {parameters:?}")));
    };
    let given = |x: f64| (x != NOTHING).then_some(x);
    // Along y as along x, where nothing else is said.
    let along = [a, given(b).unwrap_or(a)];
    Ok(match kind {
        1 => Arc::new(Lambert),
        2 => Arc::new(phong(a)?),
        3 => Arc::new(BlinnPhong::new(a)?),
        4 => Arc::new(Ward::new(along)?),
        5 => Arc::new(WardDuer::new(along)?),
        6 => Arc::new(Lafortune::new(a, [b, c, d])?),
        7 => Arc::new(CookTorrance::new(a, Fresnel::of(given(b), given(c), None)?)?),
        8 => Arc::new(Beckmann::new(along, Fresnel::of(given(c), given(d), None)?)?),
        9 => Arc::new(Ggx::new(along, Fresnel::of(given(c), given(d), None)?)?),
        10 => Arc::new(AshikhminShirley::new(along, Fresnel::of(given(d), given(e), given(c))?)?),
        _ => return Err(Error::input(format!("expected a model from 1 to 10, got {kind}"))),
    })
}

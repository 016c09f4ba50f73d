//! Making M: the only room that meets both rays and transport. A pass is a function of (scene, settings, rows), so that
//! any split over threads, machines or interrupted runs gives the same M.

pub mod bounces;
pub mod contrast;
pub mod curve;
pub mod direct;
pub mod emission;
pub mod gather;
pub mod gather_pass;
pub mod links;
pub mod lobes;
mod nearby;
pub mod node_pass;
pub mod pass;
mod projection;
pub mod radiosity;
mod reflections;
mod respond;
mod shares;
mod standing;
mod texels;
mod visibility;

pub use bounces::{Bounces, Interreflection, Share};
pub use contrast::contrast;
pub use curve::CurvePass;
pub use direct::DirectPass;
pub use emission::Emitters;
pub use gather::{Gather, Kernel, SubArea, lobe_hits, seen_from};
pub use gather_pass::GatherPass;
pub use links::{FormFactors, Gathering, Links, form_factors, links};
pub use lobes::{Lobes, Shape as LobeShape, models};
pub use node_pass::NodePass;
pub use pass::{Made, Pass, Probed, Rays, Shape, Surveyed, probe, survey, tile};
pub use respond::respond;
pub use standing::Receiver;

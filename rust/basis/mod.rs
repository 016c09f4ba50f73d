//! Pure mathematics: the bases in which light and transport are measured. No rays, no images.

pub mod bands;
pub mod cubemap;
pub mod daubechies4;
pub mod haar;
pub mod haar_tree;
pub mod harmonic_projection;
pub mod k_means;
pub mod pca;
pub mod spherical_harmonics;
pub mod texel;

pub use bands::{Bands, ColumnSpace};
pub use daubechies4::Daubechies4;
pub use haar_tree::HaarTree;
pub use harmonic_projection::{HARMONIC_FACE, HarmonicProjection};
pub use texel::Texel;

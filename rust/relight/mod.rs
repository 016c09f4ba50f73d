//! V is light: from the response of receivers to a picture.

pub mod display;
pub mod shade;

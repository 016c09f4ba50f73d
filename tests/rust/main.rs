//! The Rust suite: one module for each room of the house.
mod update;

mod transport;
mod basis;
mod light;
mod response;
mod harmonics;

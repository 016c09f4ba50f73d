//! The Rust suite: one module for each room of the house.
mod update;

mod basis;
mod light;
mod scene;
mod transport;

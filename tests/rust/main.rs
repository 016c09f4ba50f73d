//! The Rust suite: one module for each room of the house.
mod response;

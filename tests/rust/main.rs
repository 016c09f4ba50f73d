//! The Rust suite: one module for each room of the house.
mod update;
mod vertices;

mod basis;
mod bounces;
mod brdf;
mod clustered;
mod curves;
mod direct;
mod emission;
mod file;
mod harmonics;
mod light;
mod lobes;
mod pass;
mod radiance;
mod response;
mod scene;
mod sight;
mod studio;
mod suite;
mod transport;

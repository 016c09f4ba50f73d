//! Environment maps.
pub struct EnvironmentMap;

//! Arrays beside a transport: what a product does not need, but whoever looks at the scene again does. What they mean is
//! known to those who write and take them; here they are only numbers with names.

use safetensors::Dtype;

use crate::error::Result;
use crate::transport::slab::Slab;

use super::manifest::FileEntry;
use super::shard::{Directory, Shard, Tensor};

/// The file of the scene: its surfaces and their materials.
pub const SCENE: &str = "scene.safetensors";
/// The file of the nodes between which light bounces.
pub const NODES: &str = "nodes.safetensors";
/// The file of the light that surfaces give off by themselves.
pub const EMISSION: &str = "emission.safetensors";
/// The file of the lamps or groups that the columns are.
pub const LAMPS: &str = "lamps.safetensors";
/// The files that there may be, in the order of the manifest.
pub const FILES: [&str; 4] = [SCENE, NODES, EMISSION, LAMPS];

/// Numbers of one of the types that are kept beside a transport.
#[derive(Clone)]
pub enum Numbers {
    /// Places.
    F64(Slab<f64>),
    /// Colours, directions.
    F32(Slab<f32>),
    /// Indices.
    U32(Slab<u32>),
}

/// A named array.
#[derive(Clone)]
pub struct Array {
    /// Its key.
    pub name: String,
    /// Lengths of its axes.
    pub shape: Vec<usize>,
    /// Row-major.
    pub numbers: Numbers,
}

impl Array {
    fn tensor(&self) -> Tensor<'_> {
        match &self.numbers {
            Numbers::F64(items) => Tensor::new(self.name.clone(), &self.shape, items),
            Numbers::F32(items) => Tensor::new(self.name.clone(), &self.shape, items),
            Numbers::U32(items) => Tensor::new(self.name.clone(), &self.shape, items),
        }
    }
}

/// One file of arrays.
#[derive(Clone)]
pub struct Beside {
    /// One of `FILES`.
    pub file: &'static str,
    /// In the order of their names.
    pub arrays: Vec<Array>,
}

impl Beside {
    /// The arrays as they are written.
    pub(super) fn tensors(&self) -> Vec<Tensor<'_>> {
        self.arrays.iter().map(Array::tensor).collect()
    }

    /// Opens a file of the manifest; None where it is none that is known here.
    pub(super) fn read(directory: Directory, entry: &FileEntry) -> Result<Option<Beside>> {
        let Some(file) = FILES.into_iter().find(|file| *file == entry.name) else { return Ok(None) };
        let shard = Shard::open(directory, entry)?;
        let array = |(name, dtype, shape): (String, Dtype, Vec<usize>)| {
            let numbers = match dtype {
                Dtype::F64 => Numbers::F64(shard.slab(&name, &shape)?),
                Dtype::F32 => Numbers::F32(shard.slab(&name, &shape)?),
                Dtype::U32 => Numbers::U32(shard.slab(&name, &shape)?),
                other => return Err(shard.error(format!("expected {name:?} to be F64, F32 or U32, found {other:?}"))),
            };
            Ok(Array { name, shape, numbers })
        };
        Ok(Some(Beside { file, arrays: shard.arrays().into_iter().map(array).collect::<Result<_>>()? }))
    }
}

//! What targets share: transports of which one file is replaced, and bytes as numbers.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use _core::error::Error;
use _core::precompute::models;
use _core::transport::file::manifest::{MANIFEST, Manifest, sealed};
use _core::transport::file::versions::read_manifest;
use _core::transport::{Opened, open};
use _core::update::{Budget, Chain, Colours, Initial, Method, Mix, Settings, Updater};
use xxhash_rust::xxh3::xxh3_64;

/// Where the folder of the transports to begin with is said.
pub const BASES: &str = "DELTALUX_BASES";

/// A transport that is whole: its files may be replaced, and are put back.
pub struct Base {
    folder: PathBuf,
    manifest: Manifest,
    text: Vec<u8>,
    files: Vec<(String, Vec<u8>)>,
}

impl Base {
    /// All that there are, each in a copy of this process's own.
    pub fn all() -> Vec<Base> {
        let bases = PathBuf::from(std::env::var(BASES).expect("the folder of the transports to begin with"));
        let own = std::env::temp_dir().join(format!("guided-{}", std::process::id()));
        sorted(&bases).iter().map(|base| Base::copied(base, &own.join(base.file_name().unwrap()))).collect()
    }

    fn copied(from: &Path, folder: &Path) -> Base {
        fs::create_dir_all(folder).unwrap();
        let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
        let mut files = Vec::new();
        for path in sorted(from) {
            fs::copy(&path, folder.join(name(&path))).unwrap();
            files.push((name(&path), fs::read(&path).unwrap()));
        }
        let text = fs::read(folder.join(MANIFEST)).unwrap();
        files.retain(|(name, _)| name != MANIFEST);
        Base { folder: folder.to_owned(), manifest: read_manifest(folder).unwrap(), text, files }
    }

    /// Opens it with another text for its manifest, whose digest is made right.
    pub fn with_manifest(&self, text: &[u8]) {
        fs::write(self.folder.join(MANIFEST), resealed(text)).unwrap();
        used(open(&self.folder, &models));
        fs::write(self.folder.join(MANIFEST), &self.text).unwrap();
    }

    /// Opens it with other bytes in a file, which the manifest says are right.
    pub fn with_file(&self, number: usize, bytes: &[u8]) {
        let (name, before) = &self.files[number % self.files.len()];
        let mut manifest = self.manifest.clone();
        let entries = manifest.files.iter_mut().chain(&mut manifest.beside);
        for entry in entries.filter(|entry| entry.name == *name) {
            (entry.bytes, entry.xxh3) = (bytes.len() as u64, format!("{:016x}", xxh3_64(bytes)));
        }
        fs::write(self.folder.join(MANIFEST), sealed(&manifest).unwrap()).unwrap();
        fs::write(self.folder.join(name), bytes).unwrap();
        used(open(&self.folder, &models));
        fs::write(self.folder.join(name), before).unwrap();
        fs::write(self.folder.join(MANIFEST), &self.text).unwrap();
    }
}

fn sorted(folder: &Path) -> Vec<PathBuf> {
    let mut all: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    all.sort();
    all
}

/// A manifest whose last key is the digest of what stands before it; as it is where there is no such key.
fn resealed(text: &[u8]) -> Vec<u8> {
    const KEY: &[u8] = b"\"digest\"";
    match text.windows(KEY.len()).rposition(|window| window == KEY) {
        Some(at) => [&text[..at], KEY, format!(": \"{:016x}\"\n}}", xxh3_64(&text[..at])).as_bytes()].concat(),
        None => text.to_vec(),
    }
}

/// What is refused is refused as a file; what is taken must bear use.
fn used(opened: Result<Opened, Error>) {
    let product = match opened {
        Ok(opened) => opened.product,
        Err(Error::File { .. } | Error::Os { .. }) => return,
        Err(error) => panic!("not the error of a file: {error}"),
    };
    let (rows, factors) = (product.rows(), product.factors());
    let mix = (factors > 1).then(|| Mix::new(vec![1.0; rows * factors], factors).unwrap());
    let chain = Arc::new(Chain::new(product));
    let light = vec![[1.0; 3]; chain.product.first.space().columns()];
    let mut out = vec![0.0; 3 * rows];
    // A file may be too long-rowed to follow; that is an error of its own, and no crash.
    let _ = chain.multiply(&[&light], mix.as_ref(), &mut out);
    let settings = |columns: usize, terms| Settings {
        method: Method::Incremental,
        budget: Budget::Terms(terms),
        weights: vec![1.0; columns],
        costs: Vec::new(),
        colours: Colours::Joint,
    };
    let then = chain.product.then.as_ref().map(|then| settings(then.space().columns(), usize::MAX));
    let follower = Updater::new(Arc::clone(&chain), settings(light.len(), 3), then, mix, Initial::Black);
    if let Ok(mut follower) = follower {
        let _ = follower.step(&light, &mut out);
    }
}

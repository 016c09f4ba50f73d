//! Any text for a manifest: the first byte says whose.
#![no_main]

use std::sync::LazyLock;

use guided::Base;

static BASES: LazyLock<Vec<Base>> = LazyLock::new(Base::all);

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    if let [base, text @ ..] = data {
        BASES[usize::from(*base) % BASES.len()].with_manifest(text);
    }
});

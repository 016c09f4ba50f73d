//! Any bytes for a file of a transport beside its manifest: the first two say which.
#![no_main]

use std::sync::LazyLock;

use guided::Base;

static BASES: LazyLock<Vec<Base>> = LazyLock::new(Base::all);

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    if let [base, file, bytes @ ..] = data {
        BASES[usize::from(*base) % BASES.len()].with_file(usize::from(*file), bytes);
    }
});

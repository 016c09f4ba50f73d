//! Code that is compiled twice: for every processor of the target, and for AVX2, where that is found at run time.

/// Declares a function `name(...) = body;` whose body (`#[inline(always)]`) is compiled for AVX2 as well, or of two bodies the
/// second one. Both give the same bits, since Rust never fuses or reorders. Type parameters stand in square brackets.
macro_rules! compiled_twice {
    ($($(#[$about:meta])* $visible:vis fn $name:ident $([$($parameter:tt)*])? (
        $($argument:ident: $type:ty),* $(,)?
    ) $(-> $out:ty)? = $body:path $(, $wide:path)?;)*) => {$(
        $(#[$about])*
        $visible fn $name $(<$($parameter)*>)? ($($argument: $type),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            if is_x86_feature_detected!("avx2") {
                #[target_feature(enable = "avx2")]
                fn wide $(<$($parameter)*>)? ($($argument: $type),*) $(-> $out)? {
                    $crate::twice::last!($body $(, $wide)?)($($argument),*)
                }
                // SAFETY: `wide` asks for AVX2 and nothing else, and the processor has it.
                return unsafe { wide($($argument),*) };
            }
            $body($($argument),*)
        }
    )*};
}

/// The last of one or two.
macro_rules! last {
    ($one:path) => {
        $one
    };
    ($one:path, $two:path) => {
        $two
    };
}

pub(crate) use {compiled_twice, last};

//! The choice of instructions at run time: what the hot loops are compiled for, and which of it runs here.

use std::sync::OnceLock;

/// Name of the environment variable that, set to `none`, keeps the core from instructions beyond those of every processor
/// of its kind. It is read once, before the first loop, and is there for tests: results must agree to rounding.
///
/// It rules the loops of this crate; faer and matrixmultiply, which eigenvalues and small products come from, choose by
/// the processor alone.
pub const SWITCH: &str = "AMBID_SIMD";

/// What the hot loops run with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Instructions {
    /// What every processor of this kind has.
    Baseline,
    /// AVX2 and FMA of x86-64.
    Avx2,
}

impl Instructions {
    /// Those in use, the same from the first call on.
    pub fn in_use() -> Self {
        static CHOSEN: OnceLock<Instructions> = OnceLock::new();
        *CHOSEN.get_or_init(|| {
            let is_off = std::env::var_os(SWITCH).is_some_and(|value| value == "none");
            if is_off { Self::Baseline } else { Self::best() }
        })
    }

    /// The best that this processor has.
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
            return Self::Avx2;
        }
        Self::Baseline
    }

    /// One word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Avx2 => "avx2",
        }
    }
}

/// Calls `$name` compiled for AVX2 and FMA where these are in use.
///
/// The function must be generic over `const FMA: bool` and `#[inline(always)]`.
macro_rules! dispatch {
    ($name:ident, ($($argument:ident: $type:ty),*)) => {{
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2,fma")]
            fn with_avx2($($argument: $type),*) {
                $name::<true>($($argument),*);
            }
            if $crate::instructions::Instructions::in_use() == $crate::instructions::Instructions::Avx2 {
                // SAFETY: they are in use only where the processor was found to have them.
                unsafe { with_avx2($($argument),*) };
                return;
            }
        }
        $name::<{ cfg!(target_feature = "fma") || cfg!(target_arch = "aarch64") }>($($argument),*);
    }};
}
pub(crate) use dispatch;

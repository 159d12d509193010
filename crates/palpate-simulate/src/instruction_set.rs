//! Which vector instructions results come from: sums of another width round otherwise.

/// The kind of machine, as far as the last bits of a result depend on it.
pub fn instruction_set() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        // Elements are computed by pulp, products of matrices in factors with AVX-512 where there is any.
        match (pulp::Arch::new(), std::arch::is_x86_feature_detected!("avx512f")) {
            (pulp::Arch::Scalar, _) => "x86-64",
            (_, false) => "x86-64-v3",
            (_, true) => "x86-64-v3 with AVX-512",
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        std::env::consts::ARCH
    }
}

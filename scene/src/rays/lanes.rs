//! Eight numbers at a time, twice: the operations that the traversal is written in.
//!
//! Products are never fused with sums except in [`slab`](pair::slab), whose rounding the padding of the ray
//! covers: the triangle test depends on `a·b - c·d` being the exact negative of `c·d - a·b`. `min` and `max`
//! give their second operand where the first is not a number.

/// Two glam vectors: safe, SSE2 on x86-64, NEON on ARM.
pub(super) mod pair {
    use glam::Vec4;

    #[derive(Clone, Copy)]
    pub(in super::super) struct V(Vec4, Vec4);

    #[inline(always)]
    pub(in super::super) fn splat(a: f32) -> V {
        V(Vec4::splat(a), Vec4::splat(a))
    }
    #[inline(always)]
    pub(in super::super) fn load(a: &[f32; 8]) -> V {
        V(Vec4::new(a[0], a[1], a[2], a[3]), Vec4::new(a[4], a[5], a[6], a[7]))
    }
    #[inline(always)]
    pub(in super::super) fn array(a: V) -> [f32; 8] {
        let (x, y) = (a.0, a.1);
        [x.x, x.y, x.z, x.w, y.x, y.y, y.z, y.w]
    }
    #[inline(always)]
    pub(in super::super) fn add(a: V, b: V) -> V {
        V(a.0 + b.0, a.1 + b.1)
    }
    #[inline(always)]
    pub(in super::super) fn sub(a: V, b: V) -> V {
        V(a.0 - b.0, a.1 - b.1)
    }
    #[inline(always)]
    pub(in super::super) fn mul(a: V, b: V) -> V {
        V(a.0 * b.0, a.1 * b.1)
    }
    #[inline(always)]
    pub(in super::super) fn div(a: V, b: V) -> V {
        V(a.0 / b.0, a.1 / b.1)
    }
    #[inline(always)]
    pub(in super::super) fn min(a: V, b: V) -> V {
        V(a.0.min(b.0), a.1.min(b.1))
    }
    #[inline(always)]
    pub(in super::super) fn max(a: V, b: V) -> V {
        V(a.0.max(b.0), a.1.max(b.1))
    }
    /// One bit a lane: `a <= b`.
    #[inline(always)]
    pub(in super::super) fn le(a: V, b: V) -> u32 {
        a.0.cmple(b.0).bitmask() | a.1.cmple(b.1).bitmask() << 4
    }
    /// One bit a lane: `a < b`.
    #[inline(always)]
    pub(in super::super) fn lt(a: V, b: V) -> u32 {
        a.0.cmplt(b.0).bitmask() | a.1.cmplt(b.1).bitmask() << 4
    }
    /// `(plane - at) · inverse`; `scaled` is `at · inverse`, for those who fuse.
    #[inline(always)]
    pub(in super::super) fn slab(plane: V, at: f32, inverse: f32, _scaled: f32) -> V {
        mul(sub(plane, splat(at)), splat(inverse))
    }
}

/// One 256-bit register. Register-only intrinsics are safe inside a function that has the feature; loads and
/// stores go through `bytemuck`.
#[cfg(target_arch = "x86_64")]
pub(super) mod ymm {
    use std::arch::x86_64::*;

    pub(in super::super) type V = __m256;

    macro_rules! operations {
        ($($name:ident($($arg:ident: $t:ty),*) -> $r:ty = $body:expr;)*) => {
            $(
                #[inline]
                #[target_feature(enable = "avx2,fma")]
                pub(in super::super) fn $name($($arg: $t),*) -> $r {
                    $body
                }
            )*
        };
    }
    operations! {
        splat(a: f32) -> V = _mm256_set1_ps(a);
        load(a: &[f32; 8]) -> V = bytemuck::must_cast(*a);
        array(a: V) -> [f32; 8] = bytemuck::must_cast(a);
        add(a: V, b: V) -> V = _mm256_add_ps(a, b);
        sub(a: V, b: V) -> V = _mm256_sub_ps(a, b);
        mul(a: V, b: V) -> V = _mm256_mul_ps(a, b);
        div(a: V, b: V) -> V = _mm256_div_ps(a, b);
        min(a: V, b: V) -> V = _mm256_min_ps(a, b);
        max(a: V, b: V) -> V = _mm256_max_ps(a, b);
        le(a: V, b: V) -> u32 = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)) as u32;
        lt(a: V, b: V) -> u32 = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b)) as u32;
        slab(plane: V, _at: f32, inverse: f32, scaled: f32) -> V =
            _mm256_fmsub_ps(plane, splat(inverse), splat(scaled));
    }
}

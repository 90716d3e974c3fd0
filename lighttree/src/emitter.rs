//! Anything that can be put in a light tree.

use crate::LightBounds;

/// Index of a light in the user's own array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct LightId(pub u32);

impl LightId {
    /// No light: the entry of an unused row.
    pub const NONE: Self = Self(u32::MAX);
}

/// Anything that can be put in a light tree: all that a builder asks of a light.
pub trait Emitter {
    /// Bounds of this one emitter.
    fn bounds(&self) -> LightBounds;
}

impl Emitter for LightBounds {
    fn bounds(&self) -> LightBounds {
        *self
    }
}

impl<T: Emitter + ?Sized> Emitter for &T {
    fn bounds(&self) -> LightBounds {
        (**self).bounds()
    }
}

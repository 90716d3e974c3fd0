//! What moves in a built-in scene, and where it is in each frame.

use super::{cornell_lights, sun};
use crate::{RaysError, Scene};

/// What changes from frame to frame. A frame is a function of its number alone, so frames can be made in any
/// order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Motion {
    /// Nothing.
    #[default]
    Still,
    /// Bodies that shine fly around: the last instances, as many as there are bodies, and the lights on them.
    Bodies {
        /// How many.
        count: usize,
    },
    /// The sun, and with it the virtual lights that it makes: all lights. Geometry stays.
    Sun {
        /// Virtual lights asked for.
        lights: usize,
    },
}

impl Motion {
    /// Whether every frame is the same.
    pub const fn is_still(self) -> bool {
        matches!(self, Self::Still)
    }

    /// Whether rays have to be made ready again for each frame.
    pub const fn moves_geometry(self) -> bool {
        matches!(self, Self::Bodies { .. })
    }
}

impl Scene {
    /// Puts everything where it is in frame `frame`; a new scene is in frame 0. Lights keep their order and
    /// count where bodies move; those that the sun makes are all new.
    ///
    /// # Errors
    /// As [`SceneRays::build`](crate::SceneRays::build), where light has to be traced. A built-in scene gives
    /// none.
    pub fn go_to_frame(&mut self, frame: u32) -> Result<(), RaysError> {
        match self.motion {
            Motion::Still => Ok(()),
            Motion::Bodies { count } => {
                cornell_lights::go_to_frame(self, count, frame);
                Ok(())
            }
            Motion::Sun { lights } => sun::go_to_frame(self, lights, frame),
        }
    }
}

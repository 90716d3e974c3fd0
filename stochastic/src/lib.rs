//! Sampling very many lights at random with exact probabilities, and filtering what comes of it.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, on any [`LightHierarchy`](lighttree::LightHierarchy), and the
//! methods it has to be measured against. Each is a module of its own; all of them report the probability that they
//! used, so that estimates are unbiased and can be combined with other samplers (multiple importance sampling).
//!
//! - [`CutSampler`]: a cut of n subtrees for a receiver, one light from each ([`Subtrees`]).

mod cut;
mod subtrees;

pub use cut::{CutParams, CutSampler, Selection};
pub use subtrees::Subtrees;

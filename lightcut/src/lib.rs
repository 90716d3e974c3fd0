//! Lightcuts (Walter et al. 2005).

//! Clusters of points with normals: few representatives for many shading points, chosen where lighting
//! changes fast.
//!
//! Wang, Wang, Zhou, Pan and Bao, "An Efficient GPU-based Approach for Interactive Global Illumination",
//! 2009, section 3.2. Points are seeded in proportion to how much geometry varies ([`Seeding`]), and clusters
//! refined by k-means under a metric of distance and normals ([`Metric`]). The member nearest to a cluster's
//! centre speaks for it: there a host gathers light, and interpolates elsewhere.
//!
//! The same k-means with an angle for a metric groups virtual lights: [`angular_clusters`], as of Luksch,
//! Wimmer and Schwärzler, "Incrementally Baked Global Illumination", 2019.
//!
//! Differs from the first paper:
//! - the metric's α counts distances in scene radii, so that a scene's unit does not matter;
//! - a node of the quadtree shares out its seeds exactly, by largest remainders, and never more than it has
//!   points;
//! - points that no screen orders are seeded by an octree;
//! - a search for the nearest centre is exact: the k-d tree of centres gives each centre its neighbours once
//!   a round, and the triangle inequality says how many of them a point has to look at (Phillips,
//!   "Acceleration of k-Means and Related Clustering Algorithms", 2002, "sort-means");
//! - a cluster that loses all its members starts anew at the point that is worst off;
//! - the metric is no squared distance, so a round need not be better than the one before: rounds are few,
//!   and each says what it reached.
//!
//! The same input gives the same bits, for any number of threads and without feature `parallel`.
//!
//! ```
//! use clustering::{ClusterParams, Metric, OrientedPoint, Seeding, cluster};
//! use glam::Vec3;
//!
//! // A floor that meets a wall, 64 × 64 points each.
//! let points: Vec<_> = (0..64 * 64)
//!     .flat_map(|i| {
//!         let (u, v) = ((i % 64) as f32 / 64.0, (i / 64) as f32 / 64.0);
//!         let floor = OrientedPoint { position: Vec3::new(u, 0.0, v), normal: Vec3::Y };
//!         [floor, OrientedPoint { position: Vec3::new(u, v, 0.0), normal: Vec3::Z }]
//!     })
//!     .collect();
//! let metric = Metric::new(0.3, 1.0)?;
//! let clusters = cluster(&points, Seeding::Octree, &metric, &ClusterParams::with_count(50))?;
//! assert_eq!(clusters.len(), 50);
//! for k in 0..50 {
//!     let speaker = points[clusters.representative(k) as usize];
//!     assert!(clusters.members(k).iter().all(|&i| points[i as usize].normal == speaker.normal));
//! }
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

mod angular;
mod budget;
mod centres;
mod clusters;
mod error;
mod follow;
mod kmeans;
mod metric;
mod seeding;

pub use angular::{AngularClusters, angular_clusters};
pub use clusters::{Clusters, Round};
pub use error::ClusterError;
pub use kmeans::{ClusterParams, cluster};
pub use metric::{Metric, OrientedPoint};
pub use seeding::Seeding;

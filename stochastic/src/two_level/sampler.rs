//! One light by one walk down both levels.

use core::ops::Range;

use glam::Vec3;
use lighttree::rng::Decisions;
use lighttree::{
    ChildChoice, Hierarchy, ItemRanges, LightBounds, LightHierarchy, LightId, LightSample, LightSampler,
    NodeId, Receiver, ScatterLobes, Toward, TreeSampler,
};

use super::frame::Frame;
use super::{LightMesh, TwoLevelTree};

/// Draws one light by a walk to an instance, and another within its mesh.
///
/// The receiver is taken into mesh space if it has [`lobes`](Receiver::lobes) and the instance is turned,
/// mirrored and scaled alike along all axes: there boxes fit as they were built. Otherwise the nodes on the
/// way are taken to world space. Which of both it is depends on the instance and the receiver alone, so
/// probabilities are the same whenever they are asked for.
///
/// ```
/// use glam::{Affine3A, Vec3};
/// use lighttree::rng::{Decisions, Random};
/// use lighttree::{BuildParams, LambertReceiver, LightSampler, LightTree, TriangleLight};
/// use stochastic::{LightInstance, LightMesh, TwoLevelSampler, TwoLevelTree};
///
/// let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
/// let sign = [TriangleLight { corners, radiance: 2.0, two_sided: true }];
/// let mesh = LightMesh::new(LightTree::build(&sign, &BuildParams::default())?, sign.len() as u32);
///
/// let signs: Vec<_> = (0..100)
///     .map(|i| LightInstance { mesh: 0, to_world: Affine3A::from_translation(Vec3::new(0.0, 0.0, 2.0 * i as f32)) })
///     .collect();
/// let tree = TwoLevelTree::build(vec![mesh], &signs, &BuildParams::default())?;
///
/// let street = LambertReceiver { position: Vec3::new(0.3, -5.0, 31.0), normal: Vec3::Y, albedo: 0.2 };
/// let sampler = TwoLevelSampler::new(&tree);
/// let sample = sampler.sample(&street, &mut Decisions::new(Random::new(1, 2, 3))).expect("signs are above the street");
/// let (instance, light) = tree.locate(sample.light).expect("it is in the tree");
/// assert!(instance < 100 && light.0 == 0);
/// assert_eq!(sample.pmf, sampler.pmf(&street, sample.light));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct TwoLevelSampler<'t, T> {
    tree: &'t TwoLevelTree<T>,
    top: TreeSampler<'t, lighttree::LightTree>,
    choice: ChildChoice,
}

impl<'t, T: LightHierarchy> TwoLevelSampler<'t, T> {
    /// Walks down both levels of `tree`, by [`ChildChoice::MinMaxAverage`].
    pub fn new(tree: &'t TwoLevelTree<T>) -> Self {
        Self { tree, top: TreeSampler::new(tree.top()), choice: ChildChoice::default() }
    }

    /// The same walks with other probabilities.
    #[must_use]
    pub fn with_choice(self, choice: ChildChoice) -> Self {
        Self { top: self.top.with_choice(choice), choice, ..self }
    }

    /// Asks `question` of a sampler of the lights of one instance, and of the receiver as that sampler knows
    /// it.
    fn within<R: Receiver + ?Sized, A>(&self, instance: u32, receiver: &R, question: impl Question<A>) -> A {
        let frame = &self.tree.over.frames[instance as usize];
        let LightMesh { tree, .. } = self.tree.mesh(frame);
        let in_mesh = receiver.lobes().and_then(|lobes| frame.to_mesh(receiver.position(), &lobes));
        if let Some((position, lobes, grow)) = in_mesh {
            let mesh = InMesh { tree, grow };
            let walk = TreeSampler::new(&mesh).with_choice(self.choice);
            return question.ask(&walk, &MeshReceiver { position, lobes });
        }
        let world = InWorld { tree, frame };
        question.ask(&TreeSampler::new(&world).with_choice(self.choice), receiver)
    }
}

impl<T: LightHierarchy, R: Receiver + ?Sized> LightSampler<R> for TwoLevelSampler<'_, T> {
    fn sample(&self, receiver: &R, random: &mut Decisions) -> Option<LightSample> {
        let LightSample { light: LightId(instance), pmf } = self.top.sample(receiver, random)?;
        let within = self.within(instance, receiver, Draw(random))?;
        let light = LightId(self.tree.over.first_light[instance as usize] + within.light.0);
        Some(LightSample { light, pmf: pmf * within.pmf })
    }

    fn pmf(&self, receiver: &R, light: LightId) -> f64 {
        let Some((instance, light)) = self.tree.locate(light) else { return 0.0 };
        let pmf = self.top.pmf(receiver, LightId(instance));
        if pmf > 0.0 { pmf * self.within(instance, receiver, Probability(light)) } else { 0.0 }
    }
}

/// What is asked of the walk within an instance, whose type depends on the instance.
trait Question<A> {
    fn ask<R: Receiver + ?Sized>(self, walk: &impl LightSampler<R>, receiver: &R) -> A;
}

struct Draw<'r>(&'r mut Decisions);

impl Question<Option<LightSample>> for Draw<'_> {
    #[inline]
    fn ask<R: Receiver + ?Sized>(self, walk: &impl LightSampler<R>, receiver: &R) -> Option<LightSample> {
        walk.sample(receiver, self.0)
    }
}

struct Probability(LightId);

impl Question<f64> for Probability {
    fn ask<R: Receiver + ?Sized>(self, walk: &impl LightSampler<R>, receiver: &R) -> f64 {
        walk.pmf(receiver, self.0)
    }
}

/// A receiver in mesh space, known by how it scatters about. Only for walks: a surface's true bound cannot be
/// turned.
struct MeshReceiver {
    position: Vec3,
    lobes: ScatterLobes,
}

impl Receiver for MeshReceiver {
    fn position(&self) -> Vec3 {
        self.position
    }

    /// That of the lobes, which is as much as is known.
    fn scatter_bound(&self, toward: &Toward) -> f32 {
        self.scatter_importance(toward)
    }

    fn scatter_importance(&self, toward: &Toward) -> f32 {
        self.lobes.importance(toward)
    }

    fn lobes(&self) -> Option<ScatterLobes> {
        Some(self.lobes)
    }
}

/// A mesh's tree in its own space, with boxes that hold every light wherever rounding may put it.
#[derive(Debug)]
struct InMesh<'t, T> {
    tree: &'t T,
    grow: f32,
}

/// A mesh's tree in world space.
#[derive(Debug)]
struct InWorld<'t, T> {
    tree: &'t T,
    frame: &'t Frame,
}

/// All but bounds is as in the mesh's own tree.
macro_rules! same_topology {
    ($view:ident) => {
        impl<T: LightHierarchy> Hierarchy for $view<'_, T> {
            #[inline]
            fn root(&self) -> Option<NodeId> {
                self.tree.root()
            }
            #[inline]
            fn children(&self, node: NodeId) -> Range<u32> {
                self.tree.children(node)
            }
        }

        impl<T: LightHierarchy> ItemRanges for $view<'_, T> {
            #[inline]
            fn items(&self, node: NodeId) -> Range<u32> {
                self.tree.items(node)
            }
        }

        impl<T: LightHierarchy> LightHierarchy for $view<'_, T> {
            #[inline]
            fn bounds(&self, node: NodeId) -> LightBounds {
                self.transformed(&self.tree.bounds(node))
            }
            #[inline]
            fn light_at(&self, slot: u32) -> LightId {
                self.tree.light_at(slot)
            }
            #[inline]
            fn slot_of(&self, light: LightId) -> Option<u32> {
                self.tree.slot_of(light)
            }
            fn node_count(&self) -> usize {
                self.tree.node_count()
            }
            fn node_index(&self, node: NodeId) -> usize {
                self.tree.node_index(node)
            }
        }
    };
}

same_topology!(InMesh);
same_topology!(InWorld);

impl<T> InMesh<'_, T> {
    #[inline]
    fn transformed(&self, bounds: &LightBounds) -> LightBounds {
        LightBounds { min: bounds.min - self.grow, max: bounds.max + self.grow, ..*bounds }
    }
}

impl<T> InWorld<'_, T> {
    fn transformed(&self, bounds: &LightBounds) -> LightBounds {
        self.frame.bounds(bounds)
    }
}

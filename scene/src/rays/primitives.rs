//! Primitives of a scene: the triangles of all instances, one after the other.

use crate::{RaysError, Scene};

/// Which instance and triangle a primitive is.
#[derive(Clone, Debug)]
pub(super) struct Primitives {
    /// First primitive of each instance, and at the end how many there are.
    first: Vec<u32>,
    /// Mesh of each instance.
    mesh: Vec<u32>,
}

impl Primitives {
    /// # Errors
    /// Where an instance names no mesh, a triangle no vertex, or there are more than `limit` primitives.
    pub(super) fn new(scene: &Scene, limit: u64) -> Result<Self, RaysError> {
        for (mesh, m) in (0u32..).zip(&scene.meshes) {
            let missing = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= m.positions.len());
            if let Some(triangle) = m.triangles.iter().position(missing) {
                return Err(RaysError::MissingVertex { mesh, triangle: triangle as u32 });
            }
        }
        let (mut first, mut mesh, mut count) = (vec![0], Vec::with_capacity(scene.instances.len()), 0u64);
        for (instance, i) in (0u32..).zip(&scene.instances) {
            let m = scene.meshes.get(i.mesh as usize).ok_or(RaysError::MissingMesh { instance })?;
            count += m.triangles.len() as u64;
            first.push(count.min(limit) as u32);
            mesh.push(i.mesh);
        }
        if count > limit {
            return Err(RaysError::TooMany { count, limit });
        }
        Ok(Self { first, mesh })
    }

    /// How many there are.
    pub(super) fn count(&self) -> u32 {
        self.first[self.mesh.len()]
    }

    /// First primitive of an instance.
    pub(super) fn first(&self, instance: u32) -> u32 {
        self.first[instance as usize]
    }

    /// Mesh of an instance.
    pub(super) fn mesh(&self, instance: u32) -> u32 {
        self.mesh[instance as usize]
    }

    /// Instance and triangle of a primitive.
    ///
    /// # Panics
    /// If there is no such primitive.
    #[inline]
    pub(super) fn locate(&self, primitive: u32) -> (u32, u32) {
        assert!(primitive < self.count(), "primitive {primitive} of {}", self.count());
        let instance = self.first.partition_point(|&first| first <= primitive) - 1;
        (instance as u32, primitive - self.first[instance])
    }

    /// Memory held, bytes.
    pub(super) fn bytes(&self) -> usize {
        (self.first.capacity() + self.mesh.capacity()) * size_of::<u32>()
    }
}

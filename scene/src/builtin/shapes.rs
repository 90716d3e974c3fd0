//! Solid shapes for the built-in scenes.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use crate::Mesh;

/// Gathers shapes of one material. Every vertex gets a normal and a texture coordinate.
#[derive(Default)]
pub(super) struct Shapes {
    mesh: Mesh,
}

impl Shapes {
    /// What was gathered, as a mesh of `material`.
    pub(super) fn into_mesh(self, material: u32) -> Mesh {
        Mesh { material, ..self.mesh }
    }

    /// A parallelogram from `corner` along `u` and `v`; its front is the side to which `u × v` points.
    pub(super) fn quad(&mut self, corner: Vec3, u: Vec3, v: Vec3) {
        let normal = u.cross(v).normalize_or_zero();
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
        let first = self.mesh.positions.len() as u32;
        for (s, t) in corners {
            self.vertex(corner + s * u + t * v, normal, Vec2::new(s, t));
        }
        self.mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }

    /// A flat polygon of four corners, counter-clockwise seen from its front.
    pub(super) fn tetragon(&mut self, corners: [Vec3; 4]) {
        let [a, b, c, d] = corners;
        let normal = (c - a).cross(d - b).normalize_or_zero();
        let first = self.mesh.positions.len() as u32;
        for (corner, uv) in [(a, (0.0, 0.0)), (b, (1.0, 0.0)), (c, (1.0, 1.0)), (d, (0.0, 1.0))] {
            self.vertex(corner, normal, Vec2::from(uv));
        }
        self.mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }

    /// An axis-aligned box, front outwards.
    pub(super) fn cuboid(&mut self, min: Vec3, max: Vec3) {
        let d = max - min;
        let (x, y, z) = (Vec3::X * d.x, Vec3::Y * d.y, Vec3::Z * d.z);
        self.quad(min, z, y);
        self.quad(min + x, y, z);
        self.quad(min, x, z);
        self.quad(min + y, z, x);
        self.quad(min, y, x);
        self.quad(min + z, x, y);
    }

    /// A box turned about the vertical by `angle` radians, standing on `foot`.
    pub(super) fn turned_box(&mut self, foot: Vec3, size: Vec3, angle: f32) {
        let (sin, cos) = angle.sin_cos();
        let (x, z) = (Vec3::new(cos, 0.0, -sin) * size.x, Vec3::new(sin, 0.0, cos) * size.z);
        let (y, corner) = (Vec3::Y * size.y, foot - 0.5 * (x + z));
        self.quad(corner, z, y);
        self.quad(corner + x, y, z);
        self.quad(corner, x, z);
        self.quad(corner + y, z, x);
        self.quad(corner, y, x);
        self.quad(corner + z, x, y);
    }

    /// A surface of revolution about the vertical through `foot`: `profile` holds (radius, height) from the
    /// bottom up, normals are smooth within `profile` and face away from the axis.
    pub(super) fn lathe(&mut self, foot: Vec3, profile: &[Vec2], segments: u32) {
        let first = self.mesh.positions.len() as u32;
        let columns = segments + 1;
        for (row, &at) in profile.iter().enumerate() {
            let below = profile[row.saturating_sub(1)];
            let above = profile[(row + 1).min(profile.len() - 1)];
            let slope = (above - below).normalize_or_zero();
            for column in 0..columns {
                let u = column as f32 / segments as f32;
                let (sin, cos) = (u * TAU).sin_cos();
                let position = foot + Vec3::new(at.x * cos, at.y, at.x * sin);
                let normal = Vec3::new(slope.y * cos, -slope.x, slope.y * sin);
                let v = row as f32 / (profile.len() - 1).max(1) as f32;
                self.vertex(position, normal.normalize_or(Vec3::Y), Vec2::new(u, v));
            }
        }
        for row in 0..profile.len() as u32 - 1 {
            for column in 0..segments {
                let a = first + row * columns + column;
                let (b, c, d) = (a + 1, a + columns + 1, a + columns);
                // A radius of zero makes a pole: one of the two triangles would have no area.
                if profile[row as usize].x > 0.0 {
                    self.mesh.triangles.push([a, c, b]);
                }
                if profile[row as usize + 1].x > 0.0 {
                    self.mesh.triangles.push([a, d, c]);
                }
            }
        }
    }

    /// A sphere of `rings × 2 rings` facets with smooth normals.
    pub(super) fn sphere(&mut self, centre: Vec3, radius: f32, rings: u32) {
        let profile: Vec<Vec2> = (0..=rings)
            .map(|ring| {
                let angle = 0.5 * TAU * ring as f32 / rings as f32;
                let pole = ring == 0 || ring == rings;
                Vec2::new(if pole { 0.0 } else { radius * angle.sin() }, -radius * angle.cos())
            })
            .collect();
        let first = self.mesh.positions.len();
        self.lathe(centre, &profile, 2 * rings);
        for (position, normal) in self.mesh.positions[first..].iter().zip(&mut self.mesh.normals[first..]) {
            *normal = ((*position - centre) / radius).normalize_or(Vec3::Y);
        }
    }

    /// A ring (torus) about the vertical: `radius` to the middle of a tube of radius `tube`.
    pub(super) fn ring(&mut self, centre: Vec3, radius: f32, tube: f32, segments: u32, sides: u32) {
        let first = self.mesh.positions.len() as u32;
        let columns = sides + 1;
        for segment in 0..=segments {
            let (sin, cos) = (TAU * segment as f32 / segments as f32).sin_cos();
            let outward = Vec3::new(cos, 0.0, sin);
            for side in 0..=sides {
                let (up, out) = (TAU * side as f32 / sides as f32).sin_cos();
                let normal = out * outward + up * Vec3::Y;
                let uv = Vec2::new(segment as f32 / segments as f32, side as f32 / sides as f32);
                self.vertex(centre + radius * outward + tube * normal, normal, uv);
            }
        }
        for segment in 0..segments {
            for side in 0..sides {
                let a = first + segment * columns + side;
                let (b, c, d) = (a + 1, a + columns + 1, a + columns);
                self.mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }

    /// A half-circle arch: a solid band between radii `inner` and `outer` standing on two feet at
    /// `centre ± radius · along`, `depth` thick to both sides along `across` (unit, perpendicular to
    /// `along`).
    pub(super) fn arch(&mut self, centre: Vec3, along: Vec3, [inner, outer, depth]: [f32; 3], segments: u32) {
        let across = along.cross(Vec3::Y) * depth;
        let at = |radius: f32, step: u32| {
            let (sin, cos) = (0.5 * TAU * step as f32 / segments as f32).sin_cos();
            centre + radius * (cos * along + sin * Vec3::Y)
        };
        for step in 0..segments {
            let (i0, i1) = (at(inner, step), at(inner, step + 1));
            let (o0, o1) = (at(outer, step), at(outer, step + 1));
            self.tetragon([i0 + across, o0 + across, o1 + across, i1 + across]);
            self.tetragon([i1 - across, o1 - across, o0 - across, i0 - across]);
            self.tetragon([i0 - across, i0 + across, i1 + across, i1 - across]);
            self.tetragon([o0 + across, o0 - across, o1 - across, o1 + across]);
        }
    }

    /// A sheet over the rectangle from `min` to `max` (x and z), front upwards, `cells` quads along each
    /// side: `height` gives its height and slope.
    pub(super) fn height_field(
        &mut self,
        min: Vec2,
        max: Vec2,
        cells: u32,
        height: impl Fn(Vec2) -> (f32, Vec2),
    ) {
        let first = self.mesh.positions.len() as u32;
        let columns = cells + 1;
        for row in 0..=cells {
            for column in 0..=cells {
                let uv = Vec2::new(column as f32, row as f32) / cells as f32;
                let at = min + (max - min) * uv;
                let (y, slope) = height(at);
                self.vertex(Vec3::new(at.x, y, at.y), Vec3::new(-slope.x, 1.0, -slope.y).normalize(), uv);
            }
        }
        for row in 0..cells {
            for column in 0..cells {
                let a = first + row * columns + column;
                let (b, c, d) = (a + 1, a + columns + 1, a + columns);
                self.mesh.triangles.extend([[a, d, c], [a, c, b]]);
            }
        }
    }

    fn vertex(&mut self, position: Vec3, normal: Vec3, uv: Vec2) {
        self.mesh.positions.push(position);
        self.mesh.normals.push(normal);
        self.mesh.uvs.push(uv);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six times the volume that the triangles enclose, positive if they face outwards.
    fn volume(shapes: Shapes) -> f32 {
        let mesh = shapes.into_mesh(0);
        let corner = |i: u32| mesh.positions[i as usize];
        let sum: f32 =
            mesh.triangles.iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2])))).sum();
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(corner);
            let face = (b - a).cross(c - a).normalize();
            assert!(face.is_finite(), "no triangle is degenerate");
            for &i in triangle {
                assert!(mesh.normals[i as usize].is_normalized());
                assert!(face.dot(mesh.normals[i as usize]) > 0.0, "normals lie on the front");
            }
        }
        sum / 6.0
    }

    #[test]
    fn solids_are_closed_and_face_outwards() {
        let mut cube = Shapes::default();
        cube.cuboid(Vec3::splat(1.0), Vec3::new(2.0, 3.0, 4.0));
        assert!((volume(cube) - 6.0).abs() < 1e-4);

        let mut turned = Shapes::default();
        turned.turned_box(Vec3::ONE, Vec3::new(1.0, 2.0, 3.0), 0.7);
        assert!((volume(turned) - 6.0).abs() < 1e-4);

        let mut ball = Shapes::default();
        ball.sphere(Vec3::ZERO, 2.0, 32);
        assert!((volume(ball) / (4.0 / 3.0 * 0.5 * TAU * 8.0) - 1.0).abs() < 0.02);

        let mut torus = Shapes::default();
        torus.ring(Vec3::ZERO, 2.0, 0.5, 64, 32);
        assert!((volume(torus) / (0.5 * TAU * 0.25 * TAU * 2.0) - 1.0).abs() < 0.02);

        // Open at its feet, which lie in the plane y = 0 and so add nothing seen from the origin.
        let mut arch = Shapes::default();
        arch.arch(Vec3::ZERO, Vec3::X, [1.0, 2.0, 0.5], 64);
        assert!((volume(arch) / (0.25 * TAU * 3.0) - 1.0).abs() < 0.02);
    }
}

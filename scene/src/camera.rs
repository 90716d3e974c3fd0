//! A pinhole camera.

use glam::{Quat, Vec2, Vec3};
use lighttree::Ray;

/// A pinhole camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// For `--set camera=NAME`.
    pub name: String,
    /// World-space position.
    pub position: Vec3,
    /// Unit direction of view.
    pub forward: Vec3,
    /// Unit, to the right of the image.
    pub right: Vec3,
    /// Unit, to the top of the image.
    pub up: Vec3,
    /// Full vertical angle of view, radians, in (0, π).
    pub vertical_fov: f32,
}

impl Camera {
    /// A camera at `position` looking at `target`, upright by `up`.
    pub fn look_at(name: &str, position: Vec3, target: Vec3, up: Vec3, vertical_fov: f32) -> Self {
        let forward = (target - position).normalize();
        let right = forward.cross(up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
        Self { name: name.to_owned(), position, forward, right, up: right.cross(forward), vertical_fov }
    }

    /// The same camera carried round the line through `point` along the unit vector `axis`, by `angle`
    /// radians.
    #[must_use]
    pub fn turned_about(&self, point: Vec3, axis: Vec3, angle: f32) -> Self {
        let turn = Quat::from_axis_angle(axis, angle);
        Self {
            name: self.name.clone(),
            position: point + turn * (self.position - point),
            forward: turn * self.forward,
            right: turn * self.right,
            up: turn * self.up,
            vertical_fov: self.vertical_fov,
        }
    }

    /// The ray through `at` (in pixels, (0, 0) the upper left corner of the image) of a `width` × `height`
    /// image; pixels are square.
    pub fn ray(&self, at: Vec2, width: u32, height: u32) -> Ray {
        let half = (0.5 * self.vertical_fov).tan();
        let y = (1.0 - 2.0 * at.y / height as f32) * half;
        let x = (2.0 * at.x / width as f32 - 1.0) * half * (width as f32 / height as f32);
        let direction = (self.forward + x * self.right + y * self.up).normalize();
        Ray { origin: self.position, direction, t_max: f32::INFINITY }
    }

    /// Where in a `width` × `height` image `position` is seen, in pixels as [`ray`](Self::ray) has them, and
    /// its distance from the camera's plane; `None` behind that plane. May be outside the image.
    pub fn project(&self, position: Vec3, width: u32, height: u32) -> Option<Vec3> {
        let to = position - self.position;
        let depth = to.dot(self.forward);
        if depth <= 0.0 {
            return None;
        }
        let half = (0.5 * self.vertical_fov).tan() * depth;
        let aspect = width as f32 / height as f32;
        let x = 0.5 * width as f32 * (1.0 + to.dot(self.right) / (half * aspect));
        let y = 0.5 * height as f32 * (1.0 - to.dot(self.up) / half);
        Some(Vec3::new(x, y, depth))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_ray_meets_is_seen_where_the_ray_went() {
        let camera = Camera::look_at("x", Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, 1.0, 0.5), Vec3::Y, 0.8);
        for at in [Vec2::new(0.5, 0.5), Vec2::new(319.2, 17.0), Vec2::new(160.0, 90.0)] {
            let ray = camera.ray(at, 320, 180);
            let seen = camera.project(ray.origin + 7.0 * ray.direction, 320, 180).unwrap();
            assert!(seen.truncate().distance(at) < 1e-3, "{seen} for {at}");
            assert!((seen.z - 7.0 * ray.direction.dot(camera.forward)).abs() < 1e-5);
            assert_eq!(camera.project(ray.origin - ray.direction, 320, 180), None);
        }
    }

    /// Halfway round a point it sees that point from the other side, upright, in the middle of the picture.
    #[test]
    fn a_camera_goes_round_what_it_looks_at() {
        let target = Vec3::new(1.0, 2.0, 3.0);
        let camera = Camera::look_at("a", Vec3::new(4.0, 2.5, 3.0), target, Vec3::Y, 1.0);
        let turned = camera.turned_about(target, Vec3::Y, core::f32::consts::PI);
        assert!(turned.position.distance(Vec3::new(-2.0, 2.5, 3.0)) < 1e-5);
        let expected = Camera::look_at("a", turned.position, target, Vec3::Y, 1.0);
        assert!(turned.forward.distance(expected.forward) < 1e-5);
        assert!(turned.right.distance(expected.right) < 1e-5 && turned.up.distance(expected.up) < 1e-5);
    }
}

//! The Cornell box.
//!
//! Geometry and camera: Cornell University Program of Computer Graphics, "The Cornell Box", measured data, 1998.
//! Reflectances and the lamp's radiance: the RGB values in common use. Differs from the measurement: three
//! channels in place of spectra, metres in place of millimetres, and the ceiling is cut out around the lamp,
//! with which it is coplanar.

use glam::Vec3;

use super::shapes::Shapes;
use crate::{Camera, Material, Scene};

/// The published table is in millimetres, the scene in metres: divided, so that each coordinate is the
/// nearest float.
const MILLIMETRES: f32 = 1000.0;

/// 38 triangles, of which 2 emit.
pub(super) fn cornell() -> Scene {
    // The ceiling is four strips around the lamp's opening.
    let mut scene = room(&[
        [0.0, 556.0, 0.0, 227.0],
        [0.0, 556.0, 332.0, 559.2],
        [0.0, 213.0, 227.0, 332.0],
        [343.0, 556.0, 227.0, 332.0],
    ]);
    let mut lamp = Shapes::default();
    lamp.face([[343.0, 548.8, 227.0], [343.0, 548.8, 332.0], [213.0, 548.8, 332.0], [213.0, 548.8, 227.0]]);
    let emissive = Vec3::new(17.0, 12.0, 4.0);
    scene.add(lamp, Material { emissive, ..matte("lamp", 0.78, 0.78, 0.78) });
    scene.add_emissive_triangles();
    scene.name = "cornell".to_owned();
    scene
}

fn matte(name: &str, r: f32, g: f32, b: f32) -> Material {
    Material {
        name: name.to_owned(),
        base_color: Vec3::new(r, g, b),
        double_sided: false,
        ..Material::default()
    }
}

/// The box with its two blocks and the published camera, without a lamp; the ceiling covers these ranges of x
/// and z.
pub(super) fn room(ceiling: &[[f32; 4]]) -> Scene {
    let mut scene = Scene::default();
    let mut white = Shapes::default();
    // Floor and back wall.
    white.face([[552.8, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 559.2], [549.6, 0.0, 559.2]]);
    white.face([[549.6, 0.0, 559.2], [0.0, 0.0, 559.2], [0.0, 548.8, 559.2], [556.0, 548.8, 559.2]]);
    for &[x0, x1, z0, z1] in ceiling {
        white.face([[x1, 548.8, z0], [x1, 548.8, z1], [x0, 548.8, z1], [x0, 548.8, z0]]);
    }
    // Short block.
    white.face([[130.0, 165.0, 65.0], [82.0, 165.0, 225.0], [240.0, 165.0, 272.0], [290.0, 165.0, 114.0]]);
    white.face([[290.0, 0.0, 114.0], [290.0, 165.0, 114.0], [240.0, 165.0, 272.0], [240.0, 0.0, 272.0]]);
    white.face([[130.0, 0.0, 65.0], [130.0, 165.0, 65.0], [290.0, 165.0, 114.0], [290.0, 0.0, 114.0]]);
    white.face([[82.0, 0.0, 225.0], [82.0, 165.0, 225.0], [130.0, 165.0, 65.0], [130.0, 0.0, 65.0]]);
    white.face([[240.0, 0.0, 272.0], [240.0, 165.0, 272.0], [82.0, 165.0, 225.0], [82.0, 0.0, 225.0]]);
    // Tall block.
    white.face([[423.0, 330.0, 247.0], [265.0, 330.0, 296.0], [314.0, 330.0, 456.0], [472.0, 330.0, 406.0]]);
    white.face([[423.0, 0.0, 247.0], [423.0, 330.0, 247.0], [472.0, 330.0, 406.0], [472.0, 0.0, 406.0]]);
    white.face([[472.0, 0.0, 406.0], [472.0, 330.0, 406.0], [314.0, 330.0, 456.0], [314.0, 0.0, 456.0]]);
    white.face([[314.0, 0.0, 456.0], [314.0, 330.0, 456.0], [265.0, 330.0, 296.0], [265.0, 0.0, 296.0]]);
    white.face([[265.0, 0.0, 296.0], [265.0, 330.0, 296.0], [423.0, 330.0, 247.0], [423.0, 0.0, 247.0]]);
    scene.add(white, matte("white", 0.725, 0.71, 0.68));

    let mut red = Shapes::default();
    red.face([[552.8, 0.0, 0.0], [549.6, 0.0, 559.2], [556.0, 548.8, 559.2], [556.0, 548.8, 0.0]]);
    scene.add(red, matte("red", 0.63, 0.065, 0.05));

    let mut green = Shapes::default();
    green.face([[0.0, 0.0, 559.2], [0.0, 0.0, 0.0], [0.0, 548.8, 0.0], [0.0, 548.8, 559.2]]);
    scene.add(green, matte("green", 0.14, 0.45, 0.091));

    let eye = Vec3::new(278.0, 273.0, -800.0) / MILLIMETRES;
    // Focal length 35 mm, film 25 × 25 mm.
    let fov = 2.0 * (0.5_f32 * 25.0 / 35.0).atan();
    scene.cameras.push(Camera::look_at("published", eye, eye + Vec3::Z, Vec3::Y, fov));
    scene
}

impl Shapes {
    /// One row of the published table, which winds counter-clockwise seen from inside the room.
    fn face(&mut self, corners: [[f32; 3]; 4]) {
        self.tetragon(corners.map(|c| Vec3::from(c) / MILLIMETRES));
    }
}

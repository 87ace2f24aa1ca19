//! Surfaces made of triangles, from the shapes that bodies are made of.

use std::f32::consts::{PI, TAU};

/// Triangles with a colour and a normal at every corner.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Solid {
    /// m.
    pub vertices: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    pub colours: Vec<[u8; 4]>,
    pub triangles: Vec<[u32; 3]>,
}

/// Sectors of a round shape, and rings of half a sphere.
const SECTORS: u32 = 24;
const RINGS: u32 = 8;

impl Solid {
    /// Whether there is nothing to see.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Adds triangles in one colour, moved by `place`. Normals are those of the surface around each corner, weighted by
    /// area.
    pub fn add(
        &mut self,
        vertices: &[[f32; 3]],
        triangles: &[[u32; 3]],
        colour: [u8; 4],
        place: &dyn Fn([f32; 3]) -> [f32; 3],
    ) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(vertices.iter().map(|&vertex| place(vertex)));
        self.colours.extend(vertices.iter().map(|_| colour));
        let mut normals = vec![[0.0_f32; 3]; vertices.len()];
        for triangle in triangles {
            let corners = triangle.map(|corner| corner as usize);
            if corners.iter().any(|&corner| corner >= vertices.len()) {
                continue;
            }
            self.triangles.push(triangle.map(|corner| first + corner));
            let [a, b, c] = corners.map(|corner| self.vertices[first as usize + corner]);
            let normal = cross(minus(b, a), minus(c, a));
            for corner in corners {
                for (sum, part) in normals[corner].iter_mut().zip(normal) {
                    *sum += part;
                }
            }
        }
        self.normals.extend(normals.into_iter().map(unit));
    }
}

/// A sphere with half axes `half`.
#[must_use]
pub fn ellipsoid(half: [f32; 3]) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let rows = (0..=2 * RINGS).map(|ring| {
        let angle = PI * ring as f32 / (2 * RINGS) as f32;
        (angle.sin(), angle.cos())
    });
    let (mut vertices, triangles) = turned(rows);
    for vertex in &mut vertices {
        *vertex = [vertex[0] * half[0], vertex[1] * half[1], vertex[2] * half[2]];
    }
    (vertices, triangles)
}

/// A cylinder along z with round ends.
#[must_use]
pub fn capsule(radius: f32, half_length: f32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let rows = (0..=2 * RINGS + 1).map(|ring| {
        let is_top = ring <= RINGS;
        let angle = PI * (ring - u32::from(!is_top)) as f32 / (2 * RINGS) as f32;
        let shift = if is_top { half_length } else { -half_length };
        (radius * angle.sin(), radius * angle.cos() + shift)
    });
    turned(rows)
}

/// A cylinder along z. Its edges are doubled, so that they stay sharp.
#[must_use]
pub fn cylinder(radius: f32, half_length: f32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let (top, bottom) = (half_length, -half_length);
    let parts = [
        [(0.0, top), (radius, top)],
        [(radius, top), (radius, bottom)],
        [(radius, bottom), (0.0, bottom)],
    ];
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for part in parts {
        let (more, faces) = turned(part.into_iter());
        let first = vertices.len() as u32;
        vertices.extend(more);
        triangles.extend(faces.into_iter().map(|face| face.map(|corner| first + corner)));
    }
    (vertices, triangles)
}

/// A box with half edges `half`, each face with corners of its own.
#[must_use]
pub fn cuboid(half: [f32; 3]) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for axis in 0..3 {
        for side in [1.0, -1.0] {
            let first = vertices.len() as u32;
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                let mut corner = [0.0; 3];
                corner[axis] = side * half[axis];
                // The other way round on the other side, so that every face looks outwards.
                corner[u] = side * a * half[u];
                corner[v] = b * half[v];
                vertices.push(corner);
            }
            triangles.push([first, first + 1, first + 2]);
            triangles.push([first, first + 2, first + 3]);
        }
    }
    (vertices, triangles)
}

/// The surface that rows of (distance from the z axis, height), from the top down, draw when they turn about it.
fn turned(rows: impl Iterator<Item = (f32, f32)>) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let mut vertices = Vec::new();
    for (radius, height) in rows {
        vertices.extend((0..SECTORS).map(|sector| {
            let angle = TAU * sector as f32 / SECTORS as f32;
            [radius * angle.cos(), radius * angle.sin(), height]
        }));
    }
    let mut triangles = Vec::new();
    for upper in (0..vertices.len() as u32 - SECTORS).step_by(SECTORS as usize) {
        for sector in 0..SECTORS {
            let next = (sector + 1) % SECTORS;
            let (a, b) = (upper + sector, upper + next);
            triangles.push([a, a + SECTORS, b]);
            triangles.push([b, a + SECTORS, b + SECTORS]);
        }
    }
    (vertices, triangles)
}

fn minus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `vector` with length 1; upwards where it has none.
fn unit(vector: [f32; 3]) -> [f32; 3] {
    let length = vector.iter().map(|x| x * x).sum::<f32>().sqrt();
    if length > 0.0 { vector.map(|x| x / length) } else { [0.0, 0.0, 1.0] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solid((vertices, triangles): (Vec<[f32; 3]>, Vec<[u32; 3]>)) -> Solid {
        let mut solid = Solid::default();
        solid.add(&vertices, &triangles, [1, 2, 3, 255], &|vertex| vertex);
        solid
    }

    /// By the divergence theorem: a third of the sum of corner · area vector.
    fn volume(solid: &Solid) -> f32 {
        let corner = |index: u32| solid.vertices[index as usize];
        let parts = solid.triangles.iter().map(|&[a, b, c]| {
            let area = cross(minus(corner(b), corner(a)), minus(corner(c), corner(a)));
            corner(a).iter().zip(area).map(|(x, y)| x * y).sum::<f32>() / 6.0
        });
        parts.sum()
    }

    #[test]
    fn shapes_are_closed_look_outwards_and_have_their_volume() {
        let cases = [
            (solid(cuboid([1.0, 2.0, 3.0])), 48.0),
            (solid(ellipsoid([1.0, 2.0, 0.5])), 4.0 / 3.0 * PI),
            (solid(cylinder(0.5, 2.0)), PI),
            (solid(capsule(0.5, 2.0)), PI + PI / 6.0),
        ];
        for (solid, want) in cases {
            let found = volume(&solid);
            // Flat faces lie inside the round shape.
            assert!((0.95..1.0 + 1e-5).contains(&(found / want)), "{found}, expected {want}");
            assert_eq!(solid.normals.len(), solid.vertices.len());
            for (vertex, normal) in solid.vertices.iter().zip(&solid.normals) {
                let outwards: f32 = vertex.iter().zip(normal).map(|(x, n)| x * n).sum();
                assert!(outwards > 0.0, "{vertex:?} {normal:?}");
            }
        }
    }

    #[test]
    fn a_triangle_without_its_corners_is_left_out() {
        let mut solid = Solid::default();
        solid.add(&[[0.0; 3]], &[[0, 1, 2]], [0; 4], &|vertex| vertex);
        assert!(solid.is_empty());
    }
}

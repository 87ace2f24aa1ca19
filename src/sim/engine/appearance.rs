//! What a body looks like: shapes with their meshes and colours, sites, and which tendon each muscle pulls; and, of its
//! newest state, the paths of the tendons and the contacts. Nothing here changes a body.
//!
//! Positions and sizes of shapes are read as they are now, because tasks edit them when an episode starts.

use std::ffi::c_int;

use super::capture::Span;
use super::simulation::{Names, Simulation, slice};

/// Shapes by the numbers that both versions give them (`mjtGeom`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShapeKind {
    Plane,
    Sphere,
    Capsule,
    Ellipsoid,
    Cylinder,
    Box,
    Mesh,
    /// Height fields and whatever else a later version knows.
    Other,
}

impl ShapeKind {
    fn of(number: c_int) -> Self {
        match number {
            0 => Self::Plane,
            2 => Self::Sphere,
            3 => Self::Capsule,
            4 => Self::Ellipsoid,
            5 => Self::Cylinder,
            6 => Self::Box,
            7 => Self::Mesh,
            _ => Self::Other,
        }
    }
}

/// A shape, in the frame of the body that carries it.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    pub kind: ShapeKind,
    /// The body that carries it.
    pub body: usize,
    /// Half sizes as `MuJoCo` gives them: radius, or radius and half length, or half edges. m.
    pub size: [f64; 3],
    /// m.
    pub position: [f64; 3],
    /// Quaternion (w, x, y, z).
    pub orientation: [f64; 4],
    /// Red, green, blue, opacity, each 0..1.
    pub colour: [f32; 4],
    /// Viewers show groups 0 to 2.
    pub group: i32,
    /// Whether it can touch anything.
    pub collides: bool,
    /// Whether tendons go round it.
    pub wraps: bool,
    /// Its mesh, where it is one.
    pub mesh: Option<usize>,
}

/// Triangles, in the frame of the shape.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// m.
    pub vertices: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

/// A marked point of a body.
#[derive(Debug, Clone, PartialEq)]
pub struct Site {
    pub name: String,
    /// m.
    pub radius: f64,
    pub colour: [f32; 4],
    /// Viewers show groups 0 to 2.
    pub group: i32,
}

/// Everything that does not move.
#[derive(Debug, Clone, PartialEq)]
pub struct Appearance {
    pub shapes: Vec<Shape>,
    pub meshes: Vec<Mesh>,
    pub sites: Vec<Site>,
    /// For every body whether it can move at all.
    pub moves: Vec<bool>,
    /// The tendon that each muscle pulls.
    pub muscle_tendons: Vec<Option<usize>>,
}

/// Two shapes that touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// m.
    pub position: [f64; 3],
    /// Force along the normal, N.
    pub force: f64,
}

/// Arrays of a compiled model that only its looks depend on.
pub(super) struct Looks {
    geom_type: Span<c_int>,
    geom_body: Span<c_int>,
    geom_mesh: Span<c_int>,
    geom_material: Span<c_int>,
    geom_group: Span<c_int>,
    geom_collides: [Span<c_int>; 2],
    geom_colour: Span<f32>,
    wrap_type: Span<c_int>,
    wrap_object: Span<c_int>,
    body_welded_to: Span<c_int>,
    material_colour: Span<f32>,
    mesh_vertex_start: Span<c_int>,
    mesh_vertex_count: Span<c_int>,
    mesh_face_start: Span<c_int>,
    mesh_face_count: Span<c_int>,
    vertices: Span<f32>,
    faces: Span<c_int>,
    site_group: Span<c_int>,
    site_colour: Span<f32>,
    site_size: Span<f64>,
    muscle_transmission: Span<c_int>,
    muscle_target: Span<c_int>,
}

/// Where a body's state keeps its tendons and contacts. The contacts move about in memory, so this is where their address
/// stands.
#[derive(Debug, Clone, Copy)]
pub(super) struct Traces {
    tendon_start: Span<c_int>,
    tendon_count: Span<c_int>,
    tendon_points: Span<f64>,
    tendon_objects: Span<c_int>,
    contacts: *const *const u8,
    contact_stride: usize,
    contact_position: usize,
}

macro_rules! capture {
    ($module:ident, $bindings:path) => {
        pub(super) mod $module {
            use super::{Looks, Span, Traces};
            use $bindings as declared;

            /// # Safety
            /// `model` must point to a valid model of this version.
            pub(in super::super) unsafe fn looks(model: *mut declared::mjModel) -> Looks {
                // SAFETY: the caller vouches for the pointer; `m` is only read.
                let m = unsafe { &*model };
                Looks {
                    geom_type: Span::new(m.geom_type, m.ngeom, 1),
                    geom_body: Span::new(m.geom_bodyid, m.ngeom, 1),
                    geom_mesh: Span::new(m.geom_dataid, m.ngeom, 1),
                    geom_material: Span::new(m.geom_matid, m.ngeom, 1),
                    geom_group: Span::new(m.geom_group, m.ngeom, 1),
                    geom_collides: [
                        Span::new(m.geom_contype, m.ngeom, 1),
                        Span::new(m.geom_conaffinity, m.ngeom, 1),
                    ],
                    geom_colour: Span::new(m.geom_rgba, m.ngeom, 4),
                    wrap_type: Span::new(m.wrap_type, m.nwrap, 1),
                    wrap_object: Span::new(m.wrap_objid, m.nwrap, 1),
                    body_welded_to: Span::new(m.body_weldid, m.nbody, 1),
                    material_colour: Span::new(m.mat_rgba, m.nmat, 4),
                    mesh_vertex_start: Span::new(m.mesh_vertadr, m.nmesh, 1),
                    mesh_vertex_count: Span::new(m.mesh_vertnum, m.nmesh, 1),
                    mesh_face_start: Span::new(m.mesh_faceadr, m.nmesh, 1),
                    mesh_face_count: Span::new(m.mesh_facenum, m.nmesh, 1),
                    vertices: Span::new(m.mesh_vert, m.nmeshvert, 3),
                    faces: Span::new(m.mesh_face, m.nmeshface, 3),
                    site_group: Span::new(m.site_group, m.nsite, 1),
                    site_colour: Span::new(m.site_rgba, m.nsite, 4),
                    site_size: Span::new(m.site_size, m.nsite, 3),
                    muscle_transmission: Span::new(m.actuator_trntype, m.nu, 1),
                    muscle_target: Span::new(m.actuator_trnid, m.nu, 2),
                }
            }

            /// # Safety
            /// `data` must point to a valid state of this version, made for `model`.
            pub(in super::super) unsafe fn traces(
                model: *mut declared::mjModel,
                data: *mut declared::mjData,
            ) -> Traces {
                // SAFETY: the caller vouches for both pointers; they are only read.
                let (m, d) = unsafe { (&*model, &*data) };
                Traces {
                    tendon_start: Span::new(d.ten_wrapadr, m.ntendon, 1),
                    tendon_count: Span::new(d.ten_wrapnum, m.ntendon, 1),
                    // Two points for every object on the way.
                    tendon_points: Span::new(d.wrap_xpos, m.nwrap, 6),
                    tendon_objects: Span::new(d.wrap_obj, m.nwrap, 2),
                    contacts: (&raw const d.contact).cast(),
                    contact_stride: size_of::<declared::mjContact>(),
                    contact_position: std::mem::offset_of!(declared::mjContact, pos),
                }
            }
        }
    };
}

capture!(v2_3_7, super::super::bindings_2_3_7);
capture!(v3_17_0, super::super::bindings_3_17_0);

/// `mjTRN_TENDON`: the same number in both versions.
const PULLS_TENDON: c_int = 3;
/// The body that everything stands in.
const WORLD: c_int = 0;
/// `mjWRAP_SPHERE` and `mjWRAP_CYLINDER`: the same numbers in both versions.
const GOES_ROUND: [c_int; 2] = [4, 5];
/// What stands for the object at a pulley, which has no place: -2 in both versions.
const PULLEY: c_int = -2;
/// What `MuJoCo` colours a shape with that has neither colour nor material. A material's colour counts only beside this.
const NO_COLOUR: [f32; 4] = [0.5, 0.5, 0.5, 1.0];

impl Simulation {
    /// What this body looks like now.
    #[must_use]
    pub fn appearance(&self) -> Appearance {
        let looks = self.looks();
        // SAFETY: the arrays belong to this body's own model, which is not changed while they are borrowed.
        unsafe {
            Appearance {
                shapes: (0..looks.geom_type.length).map(|geom| self.shape(&looks, geom)).collect(),
                meshes: (0..looks.mesh_face_start.length)
                    .map(|mesh| triangles(&looks, mesh))
                    .collect(),
                sites: self.sites(&looks),
                moves: slice(looks.body_welded_to).iter().map(|&body| body != WORLD).collect(),
                muscle_tendons: slice(looks.muscle_transmission)
                    .iter()
                    .zip(slice(looks.muscle_target).as_chunks::<2>().0)
                    .map(|(&kind, &[tendon, _])| {
                        usize::try_from(tendon).ok().filter(|_| kind == PULLS_TENDON)
                    })
                    .collect(),
            }
        }
    }

    /// # Safety
    /// `looks` must be of this body's model, and `geom` one of its shapes.
    unsafe fn shape(&self, looks: &Looks, geom: usize) -> Shape {
        // SAFETY: the caller vouches for it.
        unsafe {
            let kind = ShapeKind::of(slice(looks.geom_type)[geom]);
            let own = row(slice(looks.geom_colour), geom);
            let material = usize::try_from(slice(looks.geom_material)[geom]).ok();
            let of_material = material.map(|material| row(slice(looks.material_colour), material));
            let is_own = own.map(f32::to_bits) != NO_COLOUR.map(f32::to_bits);
            Shape {
                kind,
                body: usize::try_from(slice(looks.geom_body)[geom]).unwrap_or(0),
                size: row(self.model_geom_size(), geom),
                position: row(self.model_geom_pos(), geom),
                orientation: row(self.model_geom_quat(), geom),
                colour: if is_own { own } else { of_material.unwrap_or(own) },
                group: slice(looks.geom_group)[geom],
                collides: looks.geom_collides.iter().any(|mask| slice(*mask)[geom] != 0),
                wraps: slice(looks.wrap_type).iter().zip(slice(looks.wrap_object)).any(
                    |(kind, &object)| {
                        GOES_ROUND.contains(kind) && usize::try_from(object) == Ok(geom)
                    },
                ),
                mesh: usize::try_from(slice(looks.geom_mesh)[geom])
                    .ok()
                    .filter(|_| kind == ShapeKind::Mesh),
            }
        }
    }

    /// # Safety
    /// `looks` must be of this body's model.
    unsafe fn sites(&self, looks: &Looks) -> Vec<Site> {
        // SAFETY: the caller vouches for it.
        let (groups, colours, sizes) =
            unsafe { (slice(looks.site_group), slice(looks.site_colour), slice(looks.site_size)) };
        let names = self.names_of(Names::Site).into_iter().enumerate();
        let site = |(site, name): (usize, String)| Site {
            name,
            radius: sizes[3 * site],
            colour: row(colours, site),
            group: groups[site],
        };
        names.map(site).collect()
    }

    /// Hands the path of every tendon to `take`, in their order: the points it passes in the newest state, m. `points` is
    /// only memory.
    pub fn tendon_paths(&self, points: &mut Vec<[f64; 3]>, mut take: impl FnMut(&[[f64; 3]])) {
        let traces = self.traces();
        // SAFETY: the arrays belong to this body, and nothing is computed while they are borrowed.
        let (starts, counts, all, objects) = unsafe {
            let (starts, counts) = (slice(traces.tendon_start), slice(traces.tendon_count));
            (starts, counts, slice(traces.tendon_points), slice(traces.tendon_objects))
        };
        let all = all.as_chunks::<3>().0;
        for (&start, &count) in starts.iter().zip(counts) {
            let (start, count) = (start.max(0) as usize, count.max(0) as usize);
            let path = all.iter().zip(objects).skip(start).take(count);
            points.clear();
            points.extend(path.filter(|(_, object)| **object != PULLEY).map(|(point, _)| point));
            take(points);
        }
    }

    /// The contacts of the newest state.
    #[must_use]
    pub fn contacts(&self) -> Vec<Contact> {
        let traces = self.traces();
        let contact = |index: usize| {
            // SAFETY: the state holds this many contacts, each as long as its version declares it; the position is read as
            // the three numbers it is.
            let position = unsafe {
                let start = (*traces.contacts).add(index * traces.contact_stride);
                start.add(traces.contact_position).cast::<[f64; 3]>().read_unaligned()
            };
            Contact { position, force: self.contact_force(index) }
        };
        (0..self.contact_count()).map(contact).collect()
    }
}

/// # Safety
/// `looks` must be of a living model, and `mesh` one of its meshes.
unsafe fn triangles(looks: &Looks, mesh: usize) -> Mesh {
    // SAFETY: the caller vouches for it.
    unsafe {
        let range = |start: Span<c_int>, count: Span<c_int>| {
            let (start, count) =
                (slice(start)[mesh].max(0) as usize, slice(count)[mesh].max(0) as usize);
            start..start + count
        };
        let vertices = slice(looks.vertices).as_chunks::<3>().0;
        let faces = slice(looks.faces).as_chunks::<3>().0;
        Mesh {
            vertices: vertices[range(looks.mesh_vertex_start, looks.mesh_vertex_count)].to_vec(),
            triangles: faces[range(looks.mesh_face_start, looks.mesh_face_count)]
                .iter()
                .map(|face| face.map(|corner| corner.max(0) as u32))
                .collect(),
        }
    }
}

/// Row `index` of a matrix with `WIDTH` columns.
fn row<T: Copy + Default, const WIDTH: usize>(matrix: &[T], index: usize) -> [T; WIDTH] {
    let mut row = [T::default(); WIDTH];
    row.copy_from_slice(&matrix[WIDTH * index..WIDTH * (index + 1)]);
    row
}

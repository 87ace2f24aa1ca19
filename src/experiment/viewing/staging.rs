//! What a body looks like on a stage, and where its parts are after a step.
//!
//! One sees the bones, the tendons and the objects. Left out are the room (what stands in the world and is larger than a
//! person), the floor, and the skin, which would hide the tendons: shapes of group 1 on a body that has bones.

use crate::record::scene::{self, Frame, Mark, Solid, Stage, StageBody};
use crate::sim::engine::{Appearance, Names, Shape, ShapeKind, Simulation};
use crate::sim::puppet::Puppet;

/// Shapes and sites of higher groups are only for physics.
const LAST_VISIBLE_GROUP: i32 = 2;
const SKIN_GROUP: i32 = 1;
/// What reaches further from its centre than this stands around, m.
const ROOM: f32 = 1.2;
/// What is less opaque is glass.
const OPAQUE: f32 = 0.95;
/// Sites smaller than this only guide tendons, m.
const SMALLEST_MARK: f64 = 0.004;
/// Thickness of a tendon at rest over the size of what its body spans.
const THREAD: f32 = 0.0022;

/// The sites of the touch sensors of a body that walks.
const FEET: [&str; 4] = ["r_foot_touch", "r_toes_touch", "l_foot_touch", "l_toes_touch"];

/// A puppet with what is asked of it again and again.
pub struct Staging {
    puppet: Puppet,
    muscle_tendons: Vec<Option<usize>>,
    marks: Vec<usize>,
    points: Vec<[f64; 3]>,
    has_feet: bool,
}

impl Staging {
    /// Sets up the stage for `puppet`, which has the pose of an episode's start.
    #[must_use]
    pub fn new(puppet: Puppet) -> (Self, Stage) {
        let body = puppet.body();
        let looks = body.appearance();
        let marks = marks(&looks, body);
        let mut stage = Stage {
            bodies: bodies(&looks, body),
            muscles: body.names_of(Names::Actuator),
            strongest: strongest(body),
            marks: marks.iter().map(|&site| mark(&looks, site)).collect(),
            ..Stage::default()
        };
        let Appearance { muscle_tendons, .. } = looks;
        let has_feet = FEET.iter().all(|foot| body.find(Names::Site, foot).is_ok());
        let mut staging = Self { puppet, muscle_tendons, marks, points: Vec::new(), has_feet };
        let start = staging.frame(0, false);
        set_eye(&mut stage, &start, staging.puppet.body());
        (staging, stage)
    }

    /// The puppet, to be posed.
    pub fn puppet_mut(&mut self) -> &mut Puppet {
        &mut self.puppet
    }

    /// Whether its feet feel the ground.
    #[must_use]
    pub fn has_feet(&self) -> bool {
        self.has_feet
    }

    /// Where everything is in the puppet's pose.
    pub fn frame(&mut self, step: usize, solved: bool) -> Frame {
        let body = self.puppet.body();
        let mut tendons = Vec::new();
        body.tendon_paths(&mut self.points, |path| {
            tendons.push(path.iter().map(|&point| point.map(|x| x as f32)).collect());
        });
        let path = |tendon: &Option<usize>| {
            tendon.and_then(|tendon| tendons.get(tendon).cloned()).unwrap_or_default()
        };
        let positions = body.body_positions().as_chunks::<3>().0;
        let turns = body.body_orientations().as_chunks::<4>().0;
        let sites = body.site_positions().as_chunks::<3>().0;
        Frame {
            step,
            bodies: positions
                .iter()
                .zip(turns)
                .map(|(position, &[w, x, y, z])| {
                    (position.map(|x| x as f32), [x, y, z, w].map(|x| x as f32))
                })
                .collect(),
            paths: self.muscle_tendons.iter().map(path).collect(),
            activation: body.activation().iter().map(|&a| a as f32).collect(),
            force: body.muscle_force().iter().map(|&force| -force as f32).collect(),
            marks: self.marks.iter().map(|&site| sites[site].map(|x| x as f32)).collect(),
            contacts: body
                .contacts()
                .iter()
                .map(|contact| (contact.position.map(|x| x as f32), contact.force as f32))
                .collect(),
            solved,
        }
    }
}

/// The surface of every body.
fn bodies(looks: &Appearance, body: &Simulation) -> Vec<StageBody> {
    let names = body.names_of(Names::Body);
    let mut bodies: Vec<StageBody> =
        names.into_iter().map(|name| StageBody { name, ..StageBody::default() }).collect();
    for shape in looks.shapes.iter().filter(|shape| is_visible(shape, looks)) {
        let colour = shape.colour.map(|part| (part.clamp(0.0, 1.0) * 255.0).round() as u8);
        let stage_body = &mut bodies[shape.body];
        let opaque = shape.colour[3] >= OPAQUE;
        let solid = if opaque { &mut stage_body.solid } else { &mut stage_body.glass };
        add(solid, shape, looks, colour);
    }
    bodies
}

fn is_visible(shape: &Shape, looks: &Appearance) -> bool {
    let has_bones =
        |body| looks.shapes.iter().any(|other| other.body == body && other.kind == ShapeKind::Mesh);
    let is_skin = shape.group == SKIN_GROUP && (shape.body == 0 || has_bones(shape.body));
    let is_room = shape.body == 0 && reach(shape, looks) > ROOM;
    (0..=LAST_VISIBLE_GROUP).contains(&shape.group)
        && shape.colour[3] > 0.0
        && !matches!(shape.kind, ShapeKind::Plane | ShapeKind::Other)
        && !is_skin
        && !is_room
}

/// How far a mesh goes from its centre, m.
fn reach(shape: &Shape, looks: &Appearance) -> f32 {
    let vertices = shape.mesh.and_then(|mesh| looks.meshes.get(mesh)).map(|mesh| &mesh.vertices);
    vertices.into_iter().flatten().flatten().fold(0.0, |most: f32, x| most.max(x.abs()))
}

/// Adds a shape to the surface of its body.
fn add(solid: &mut Solid, shape: &Shape, looks: &Appearance, colour: [u8; 4]) {
    let position = shape.position.map(|x| x as f32);
    let turn = matrix(shape.orientation);
    let place = |vertex: [f32; 3]| -> [f32; 3] {
        std::array::from_fn(|axis| {
            let row: [f32; 3] = turn[axis];
            position[axis] + row.iter().zip(vertex).map(|(a, b)| a * b).sum::<f32>()
        })
    };
    let size = shape.size.map(|x| x as f32);
    let made;
    let (vertices, triangles) = match (shape.kind, shape.mesh.and_then(|m| looks.meshes.get(m))) {
        (ShapeKind::Mesh, Some(mesh)) => (&mesh.vertices, &mesh.triangles),
        (kind, _) => {
            made = match kind {
                ShapeKind::Sphere => scene::ellipsoid([size[0]; 3]),
                ShapeKind::Ellipsoid => scene::ellipsoid(size),
                ShapeKind::Capsule => scene::capsule(size[0], size[1]),
                ShapeKind::Cylinder => scene::cylinder(size[0], size[1]),
                ShapeKind::Box => scene::cuboid(size),
                ShapeKind::Mesh | ShapeKind::Plane | ShapeKind::Other => return,
            };
            (&made.0, &made.1)
        }
    };
    solid.add(vertices, triangles, colour, &place);
}

/// The rotation of a quaternion (w, x, y, z), row by row.
fn matrix(quaternion: [f64; 4]) -> [[f32; 3]; 3] {
    let [w, x, y, z] = quaternion;
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    .map(|row| row.map(|x| x as f32))
}

/// The sites that mark a target.
fn marks(looks: &Appearance, body: &Simulation) -> Vec<usize> {
    let names = body.names_of(Names::Site);
    let is_mark = |&site: &usize| {
        let look = &looks.sites[site];
        let name = names[site].to_lowercase();
        let says_so = ["target", "goal", "eps_ball"].iter().any(|word| name.contains(word));
        says_so && look.radius >= SMALLEST_MARK && look.colour[3] > 0.0
    };
    (0..looks.sites.len()).filter(is_mark).collect()
}

fn mark(looks: &Appearance, site: usize) -> Mark {
    let look = &looks.sites[site];
    Mark {
        name: look.name.clone(),
        radius: look.radius as f32,
        colour: look.colour.map(|part| (part.clamp(0.0, 1.0) * 255.0).round() as u8),
    }
}

/// The force each muscle reaches when fully active at its best length, N.
fn strongest(body: &Simulation) -> Vec<f32> {
    body.muscle_models().iter().map(|muscle| muscle.strongest() as f32).collect()
}

/// Looks at what the tendons span, a little from above.
fn set_eye(stage: &mut Stage, start: &Frame, body: &Simulation) {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for point in start.paths.iter().flatten() {
        for axis in 0..3 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    if low[0] > high[0] {
        (low, high) = ([-0.5; 3], [0.5; 3]);
    }
    let centre: [f32; 3] = std::array::from_fn(|axis| f32::midpoint(low[axis], high[axis]));
    let span = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f32::max);
    stage.thread = THREAD * span;
    stage.look_at = centre;
    stage.eye = [centre[0] + 0.9 * span, centre[1] - 0.9 * span, centre[2] + 0.5 * span];
    let names = body.names_of(Names::Body);
    stage.follow = names.iter().position(|name| name == "pelvis");
}

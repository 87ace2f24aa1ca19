//! What a body looks like on a stage, and where its parts are after a step.
//!
//! One sees the bones, the tendons, the objects and what is to be reached, which the task says: models carry marks that
//! nobody moves. Left out are the room (what stands in the world and is larger than a person), the floor, the skin, which
//! would hide the tendons (shapes of group 1), and what tendons go round.

use crate::record::scene::{self, Frame, Pose, Solid, Stage, StageBody};
use crate::sim::engine::{Appearance, Names, Shape, ShapeKind, Simulation};
use crate::sim::environment::Environment;
use crate::sim::puppet::{Puppet, Snapshot};
use crate::sim::tasks::{Place, Target};

/// Shapes of higher groups are only for physics.
const LAST_VISIBLE_GROUP: i32 = 2;
const SKIN_GROUP: i32 = 1;
/// What reaches further from its centre than this stands around, m.
const ROOM: f32 = 1.2;
/// What is less opaque is glass.
const OPAQUE: u8 = 242;
/// The body that shows where an object belongs: in a box, or in the pose of another pen or die.
const GOAL: &str = "target";
/// One sees through it what is inside.
const SEE_THROUGH: u8 = 100;
/// A box with a longer half edge than this is furniture, m.
const FURNITURE: f64 = 0.08;
/// The colour of furniture, which mostly has only a texture, and would outshine the bones.
const WOOD: [u8; 4] = [112, 104, 96, 255];
/// A body of this name is a table.
const TABLE: &str = "table";
/// By how much a goal is seen beside whoever walks to it, rad.
const BESIDE: f32 = 0.5;
/// What is further than this from the middle of the body belongs to one side of it, m.
const AT_ONE_SIDE: f32 = 0.05;
/// Thickness of a tendon at rest over the size of what all tendons span.
const THREAD: f32 = 0.0022;

/// The sites of the touch sensors of a body that walks.
const FEET: [&str; 4] = ["r_foot_touch", "r_toes_touch", "l_foot_touch", "l_toes_touch"];

/// What an episode is about.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Aim {
    pub targets: Vec<Target>,
    /// The positions of all joints, where they are to be reached.
    pub pose: Option<Vec<f64>>,
}

impl Aim {
    /// What the episode that `environment` plays is about.
    #[must_use]
    pub fn of(environment: &Environment) -> Self {
        let task = environment.task();
        Self { targets: task.targets(), pose: task.target_pose().map(<[f64]>::to_vec) }
    }
}

/// A puppet with what is asked of it again and again.
pub struct Staging {
    puppet: Puppet,
    muscle_tendons: Vec<Option<usize>>,
    points: Vec<[f64; 3]>,
}

impl Staging {
    /// Sets up the stage for `puppet`, which has the pose of an episode's start, and for what the episode is about.
    #[must_use]
    pub fn new(mut puppet: Puppet, aim: &Aim) -> (Self, Stage) {
        let looks = puppet.body().appearance();
        let ghost = aim.pose.as_ref().map(|pose| ghost(&mut puppet, pose, &looks.moves));
        let body = puppet.body();
        let mut stage = Stage {
            bodies: bodies(&looks, body),
            ghost: ghost.unwrap_or_default(),
            muscles: body.names_of(Names::Actuator),
            strongest: strongest(body),
            targets: aim.targets.iter().map(|target| target.radius as f32).collect(),
            floor: FEET.iter().all(|foot| body.find(Names::Site, foot).is_ok()),
            ..Stage::default()
        };
        let Appearance { muscle_tendons, moves, .. } = looks;
        let mut staging = Self { puppet, muscle_tendons, points: Vec::new() };
        let start = staging.frame(0, false, &aim.targets);
        set_eye(&mut stage, &start, &moves, staging.puppet.body());
        (staging, stage)
    }

    /// The puppet, to be posed.
    pub fn puppet_mut(&mut self) -> &mut Puppet {
        &mut self.puppet
    }

    /// Where everything is in the puppet's pose, and the `targets` that hold in it.
    pub fn frame(&mut self, step: usize, solved: bool, targets: &[Target]) -> Frame {
        let body = self.puppet.body();
        let mut tendons = Vec::new();
        body.tendon_paths(&mut self.points, |path| {
            tendons.push(path.iter().map(|&point| point.map(|x| x as f32)).collect());
        });
        let path = |tendon: &Option<usize>| {
            tendon.and_then(|tendon| tendons.get(tendon).cloned()).unwrap_or_default()
        };
        let sites = body.site_positions().as_chunks::<3>().0;
        let target = |target: &Target| {
            let position = match target.place {
                Place::Site(site) => sites[site],
                Place::Point(point) => point,
            };
            position.map(|x| x as f32)
        };
        Frame {
            step,
            bodies: poses(body).collect(),
            paths: self.muscle_tendons.iter().map(path).collect(),
            activation: body.activation().iter().map(|&a| a as f32).collect(),
            force: body.muscle_force().iter().map(|&force| -force as f32).collect(),
            targets: targets.iter().map(target).collect(),
            contacts: body
                .contacts()
                .iter()
                .map(|contact| (contact.position.map(|x| x as f32), contact.force as f32))
                .collect(),
            solved,
        }
    }
}

/// Where every body is.
fn poses(body: &Simulation) -> impl Iterator<Item = Pose> {
    let positions = body.body_positions().as_chunks::<3>().0;
    let turns = body.body_orientations().as_chunks::<4>().0;
    positions.iter().zip(turns).map(|(position, &[w, x, y, z])| {
        (position.map(|x| x as f32), [x, y, z, w].map(|x| x as f32))
    })
}

/// Where those bodies would be that can move, in the `pose` to be reached. The puppet is left as it was.
fn ghost(puppet: &mut Puppet, pose: &[f64], moves: &[bool]) -> Vec<(usize, Pose)> {
    let before = Snapshot::of(puppet.body());
    puppet.bend(|qpos, _| qpos.copy_from_slice(pose));
    let ghost = poses(puppet.body()).enumerate().filter(|(body, _)| moves[*body]).collect();
    puppet.pose(&before);
    ghost
}

/// The surface of every body.
fn bodies(looks: &Appearance, body: &Simulation) -> Vec<StageBody> {
    let names = body.names_of(Names::Body);
    let mut bodies: Vec<StageBody> =
        names.into_iter().map(|name| StageBody { name, ..StageBody::default() }).collect();
    for shape in looks.shapes.iter().filter(|shape| is_visible(shape, looks)) {
        let stage_body = &mut bodies[shape.body];
        let is_furniture =
            shape.kind == ShapeKind::Box && shape.size.iter().any(|x| *x > FURNITURE);
        let own = shape.colour.map(|part| (part.clamp(0.0, 1.0) * 255.0).round() as u8);
        let mut colour = if is_furniture { WOOD } else { own };
        if stage_body.name == GOAL {
            colour[3] = colour[3].min(SEE_THROUGH);
        }
        let opaque = colour[3] >= OPAQUE;
        let solid = if opaque { &mut stage_body.solid } else { &mut stage_body.glass };
        add(solid, shape, looks, colour);
    }
    bodies
}

fn is_visible(shape: &Shape, looks: &Appearance) -> bool {
    let is_room = shape.body == 0 && reach(shape, looks) > ROOM;
    (0..=LAST_VISIBLE_GROUP).contains(&shape.group)
        && shape.colour[3] > 0.0
        && !matches!(shape.kind, ShapeKind::Plane | ShapeKind::Other)
        && shape.group != SKIN_GROUP
        && !shape.wraps
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

/// The force each muscle reaches when fully active at its best length, N.
fn strongest(body: &Simulation) -> Vec<f32> {
    body.muscle_models().iter().map(|muscle| muscle.strongest() as f32).collect()
}

/// Looks at everything that moves and at what is to be reached, from the side on which it is, a little from above.
fn set_eye(stage: &mut Stage, start: &Frame, moves: &[bool], body: &Simulation) {
    let (mut seen, mut tendons) = (Span::default(), Span::default());
    start.paths.iter().flatten().for_each(|&point| tendons.take(point));
    start.paths.iter().flatten().for_each(|&point| seen.take(point));
    // Whoever walks is seen large, and the goal behind.
    if !stage.floor {
        start.targets.iter().for_each(|&target| seen.take(target));
    }
    let moving = stage.bodies.iter().zip(&start.bodies).zip(moves).filter(|(_, moves)| **moves);
    for ((body, &pose), _) in moving {
        body.solid.vertices.iter().for_each(|&vertex| seen.take(placed(vertex, pose)));
    }
    for &(body, pose) in &stage.ghost {
        stage.bodies[body].solid.vertices.iter().for_each(|&v| seen.take(placed(v, pose)));
    }
    stage.thread = THREAD * tendons.size();
    let (centre, size) = (seen.centre(), seen.size());
    let side = if centre[0] < -AT_ONE_SIDE { -1.0 } else { 1.0 };
    let (away, height) = match start.targets.first() {
        Some(&goal) if stage.floor => (turned_from(centre, goal), 0.4),
        // What is to be reached on a table is seen from above.
        Some(_) if stage.bodies.iter().any(|body| body.name == TABLE) => ([0.6 * side, -0.65], 1.0),
        _ => ([0.82 * side, -0.82], 0.44),
    };
    stage.look_at = centre;
    stage.eye = [centre[0] + away[0] * size, centre[1] + away[1] * size, centre[2] + height * size];
    let names = body.names_of(Names::Body);
    stage.follow = names.iter().position(|name| name == "pelvis");
}

/// A direction in the plane from which one sees `goal` behind `centre`, and beside it.
fn turned_from(centre: [f32; 3], goal: [f32; 3]) -> [f32; 2] {
    let towards = [goal[0] - centre[0], goal[1] - centre[1]];
    let length = towards[0].hypot(towards[1]).max(f32::MIN_POSITIVE);
    let [x, y] = towards.map(|x| -1.1 * x / length);
    let (sine, cosine) = BESIDE.sin_cos();
    [cosine * x - sine * y, sine * x + cosine * y]
}

/// A vertex of a body in the world.
fn placed(vertex: [f32; 3], (position, [x, y, z, w]): Pose) -> [f32; 3] {
    let turn = matrix([w, x, y, z].map(f64::from));
    std::array::from_fn(|axis| {
        position[axis] + turn[axis].iter().zip(vertex).map(|(a, b)| a * b).sum::<f32>()
    })
}

/// The box that holds some points.
struct Span {
    low: [f32; 3],
    high: [f32; 3],
}

impl Default for Span {
    fn default() -> Self {
        Self { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] }
    }
}

impl Span {
    fn take(&mut self, point: [f32; 3]) {
        for ((low, high), x) in self.low.iter_mut().zip(&mut self.high).zip(point) {
            *low = low.min(x);
            *high = high.max(x);
        }
    }

    /// Longest edge; one metre where there are no points.
    fn size(&self) -> f32 {
        let size = (0..3).map(|axis| self.high[axis] - self.low[axis]).fold(0.0, f32::max);
        if size > 0.0 { size } else { 1.0 }
    }

    /// The middle; the origin where there are no points.
    fn centre(&self) -> [f32; 3] {
        let middle = |axis: usize| f32::midpoint(self.low[axis], self.high[axis]);
        std::array::from_fn(
            |axis| if self.low[axis] <= self.high[axis] { middle(axis) } else { 0.0 },
        )
    }
}

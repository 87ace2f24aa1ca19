//! What one sees of a take: bodies, tendons, targets and contacts, below `TAKE/body`, `TAKE/tendons`, `TAKE/targets` and
//! `TAKE/contacts`; and below `TAKE/ghost` the bodies once more where they should be.
//!
//! Surfaces are said once; what changes from frame to frame are the poses. Many frames make one chunk per entity.

use re_sdk::EntityPath;
use re_sdk_types::archetypes::{LineStrips3D, Mesh3D, Points3D, Transform3D, ViewCoordinates};
use re_sdk_types::components::{
    AlbedoFactor, Color, LineStrip3D, Position3D, Radius, RotationQuat, Translation3D,
};
use re_sdk_types::datatypes::Quaternion;

use crate::units::Seconds;

use super::store::{SceneError, Store};
use super::{Frame, Solid, Stage, StageBody, palette};

/// A tendon that pulls as hard as it can is this much thicker than one that does not.
const SWELLING: f32 = 3.5;
/// How opaque is what should be and is not, 0 to 255.
const GHOST: u8 = 110;
/// How opaque a target is: what is inside it has to be seen.
const TARGET: u8 = 120;
/// A contact of this force is drawn with the radius of three threads, N.
const FIRM_CONTACT: f32 = 10.0;

/// Says what does not change.
pub(super) fn set(store: &mut Store, take: &EntityPath, stage: &Stage) -> Result<(), SceneError> {
    store.fixed(take.clone(), &ViewCoordinates::RIGHT_HAND_Z_UP())?;
    for (place, body) in stage.bodies.iter().enumerate() {
        let path = body_path(take, stage, place);
        if !body.solid.is_empty() {
            store.fixed(path.join(&"surface".into()), &mesh(&body.solid))?;
        }
        if !body.glass.is_empty() {
            store.fixed(
                path.join(&"glass".into()),
                &mesh(&body.glass).with_albedo_factor(glass(&body.glass)),
            )?;
        }
    }
    for &(place, (position, turn)) in &stage.ghost {
        let body = &stage.bodies[place];
        if !body.solid.is_empty() {
            let path = ghost_path(take, stage, place);
            let there = Transform3D::from_translation_rotation(
                Translation3D::from(position),
                Quaternion::from_xyzw(turn),
            );
            store.fixed(path.clone(), &there)?;
            let shape = Mesh3D::new(body.solid.vertices.iter().copied())
                .with_vertex_normals(body.solid.normals.iter().copied())
                .with_triangle_indices(body.solid.triangles.iter().copied());
            store.fixed(path, &shape)?;
        }
    }
    Ok(())
}

/// A surface in its own colours.
fn mesh(solid: &Solid) -> Mesh3D {
    let colour = |[red, green, blue, _]: &[u8; 4]| Color::from_rgb(*red, *green, *blue);
    Mesh3D::new(solid.vertices.iter().copied())
        .with_vertex_normals(solid.normals.iter().copied())
        .with_vertex_colors(solid.colours.iter().map(colour))
        .with_triangle_indices(solid.triangles.iter().copied())
}

/// The viewer has one opacity for a whole surface: that of its most opaque part.
fn glass(solid: &Solid) -> AlbedoFactor {
    let opacity = solid.colours.iter().map(|colour| colour[3]).max().unwrap_or(u8::MAX);
    AlbedoFactor::from([u8::MAX, u8::MAX, u8::MAX, opacity])
}

/// What a body is called: by its number where it has no name.
fn name(place: usize, body: &StageBody) -> String {
    if body.name.is_empty() { format!("body_{place}") } else { body.name.clone() }
}

/// Where a body stands.
pub(super) fn body_path(take: &EntityPath, stage: &Stage, place: usize) -> EntityPath {
    let name = name(place, &stage.bodies[place]);
    part(take, "body").join(&EntityPath::from_single_string(name))
}

/// Where it should stand.
fn ghost_path(take: &EntityPath, stage: &Stage, place: usize) -> EntityPath {
    let name = name(place, &stage.bodies[place]);
    part(take, "ghost").join(&EntityPath::from_single_string(name))
}

/// Says where everything is in `frames`.
pub(super) fn show(
    store: &mut Store,
    take: &EntityPath,
    stage: &Stage,
    frames: &[Frame],
    interval: Seconds,
) -> Result<(), SceneError> {
    let steps: Vec<usize> = frames.iter().map(|frame| frame.step).collect();
    for (place, body) in stage.bodies.iter().enumerate() {
        if body.solid.is_empty() && body.glass.is_empty() && stage.follow != Some(place) {
            continue;
        }
        let poses = || frames.iter().map(|frame| frame.bodies[place]);
        let transform = Transform3D::update_fields()
            .with_many_translation(poses().map(|(position, _)| Translation3D::from(position)))
            .with_many_quaternion(
                poses().map(|(_, turn)| RotationQuat(Quaternion::from_xyzw(turn))),
            );
        let columns = transform.columns_of_unit_batches()?;
        store.rows(body_path(take, stage, place), &steps, interval, columns)?;
    }
    for &(place, _) in
        stage.ghost.iter().filter(|(place, _)| !stage.bodies[*place].solid.is_empty())
    {
        let columns = Mesh3D::update_fields()
            .with_many_albedo_factor(frames.iter().map(|frame| reached(frame, GHOST)))
            .columns_of_unit_batches()?;
        store.rows(ghost_path(take, stage, place), &steps, interval, columns)?;
    }
    store.rows(part(take, "tendons"), &steps, interval, tendons(stage, frames)?)?;
    if !stage.targets.is_empty() {
        store.rows(part(take, "targets"), &steps, interval, targets(stage, frames)?)?;
    }
    store.rows(part(take, "contacts"), &steps, interval, contacts(stage, frames)?)
}

fn part(take: &EntityPath, name: &str) -> EntityPath {
    take.join(&EntityPath::from_single_string(name))
}

type Columns = std::vec::IntoIter<re_sdk::SerializedComponentColumn>;

/// Every muscle's path: coloured by activation, thick by force.
fn tendons(stage: &Stage, frames: &[Frame]) -> Result<Columns, SceneError> {
    let muscles = frames.iter().flat_map(|frame| (0..frame.paths.len()).map(move |m| (frame, m)));
    let radius = |(frame, muscle): (&Frame, usize)| {
        let share = frame.force[muscle] / stage.strongest[muscle].max(f32::MIN_POSITIVE);
        Radius::from(stage.thread * (1.0 + (SWELLING - 1.0) * share.clamp(0.0, 1.0)))
    };
    let colour = |(frame, muscle): (&Frame, usize)| {
        let [red, green, blue] = palette::activation(frame.activation[muscle]);
        Color::from_rgb(red, green, blue)
    };
    let strips = frames.iter().flat_map(|frame| &frame.paths);
    let columns = LineStrips3D::update_fields()
        .with_strips(strips.map(|path| LineStrip3D::from(path.iter().copied())))
        .with_radii(muscles.clone().map(radius))
        .with_colors(muscles.map(colour))
        .columns(frames.iter().map(|frame| frame.paths.len()))?;
    Ok(columns.collect::<Vec<_>>().into_iter())
}

/// The colour of what is to be reached, which is another once it is.
fn reached(frame: &Frame, opacity: u8) -> [u8; 4] {
    let [red, green, blue] = if frame.solved { palette::SOLVED } else { palette::OPEN };
    [red, green, blue, opacity]
}

/// The targets, in another colour where the step counts as solved.
fn targets(stage: &Stage, frames: &[Frame]) -> Result<Columns, SceneError> {
    let all = || frames.iter().flat_map(|frame| stage.targets.iter().map(move |&r| (frame, r)));
    let colour = |(frame, _): (&Frame, f32)| {
        let [red, green, blue, opacity] = reached(frame, TARGET);
        Color::from_unmultiplied_rgba(red, green, blue, opacity)
    };
    let positions = frames.iter().flat_map(|frame| frame.targets.iter().copied());
    let columns = Points3D::update_fields()
        .with_positions(positions.map(Position3D::from))
        .with_radii(all().map(|(_, radius)| Radius::from(radius)))
        .with_colors(all().map(colour))
        .columns(frames.iter().map(|_| stage.targets.len()))?;
    Ok(columns.collect::<Vec<_>>().into_iter())
}

/// A point where two shapes touch, as large as they push.
fn contacts(stage: &Stage, frames: &[Frame]) -> Result<Columns, SceneError> {
    let all = || frames.iter().flat_map(|frame| frame.contacts.iter().copied());
    let [red, green, blue] = palette::CONTACT;
    let radius = |(_, force): ([f32; 3], f32)| {
        Radius::from(stage.thread * (1.0 + 2.0 * (force / FIRM_CONTACT).clamp(0.0, 1.0)))
    };
    let columns = Points3D::update_fields()
        .with_positions(all().map(|(position, _)| Position3D::from(position)))
        .with_radii(all().map(radius))
        .with_colors(all().map(|_| Color::from_rgb(red, green, blue)))
        .columns(frames.iter().map(|frame| frame.contacts.len()))?;
    Ok(columns.collect::<Vec<_>>().into_iter())
}

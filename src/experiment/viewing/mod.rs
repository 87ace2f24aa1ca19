//! Looking: from a recorded or a running episode to a scene for the viewer.
//!
//! * [`acts`]: an episode by one or several policies.
//! * [`staging`]: what a body looks like, and where its parts are.
//! * [`replay`]: a recorded episode, played again to see the body. Physics is exact, so the start and the recorded
//!   excitations give the very states; joints that differ from the recorded ones are an error and not shown.
//! * [`signals`]: what was recorded, as lines; [`gait`]: how far each leg is in its cycle.
//! * [`watching`]: the same while it is played; `told`: the numbers of steps that are not shown.

pub mod acts;
pub mod gait;
pub mod replay;
pub mod signals;
mod stagehand;
pub mod staging;
mod told;
mod usher;
pub mod watching;

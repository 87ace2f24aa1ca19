//! What a run is to be: tasks, recipe, length, seed, and what it begins with.

use serde::Serialize;
use serde_json::{Value, json};

use super::recipe::Recipe;
use super::start::Start;
use super::teacher::TeacherPolicy;
use crate::sim::tasks::Definition;

/// Everything that decides the result of a run.
#[derive(Debug, Clone)]
pub struct Plan<R = Recipe> {
    /// What is trained on.
    pub tasks: Vec<TaskPlan>,
    pub recipe: R,
    pub seed: u64,
    /// Control steps of all environments together, on top of those that `start` has seen.
    pub total_steps: u64,
    /// What it begins with, if not with nothing.
    pub start: Option<Start>,
}

/// One task of a run.
#[derive(Debug, Clone)]
pub struct TaskPlan {
    pub definition: &'static Definition,
    /// How many bodies play it.
    pub environments: usize,
    /// Whom it is learned from.
    pub teacher: Option<TeacherPolicy>,
}

impl<R: Serialize> Plan<R> {
    /// Control steps that were done before this run.
    #[must_use]
    pub fn first_step(&self) -> u64 {
        self.start.as_ref().map_or(0, |start| start.steps)
    }

    /// Control steps at its end.
    #[must_use]
    pub fn last_step(&self) -> u64 {
        self.first_step().saturating_add(self.total_steps)
    }

    /// As `args.json` holds it.
    #[must_use]
    pub fn document(&self) -> Value {
        let teacher = |task: &TaskPlan| {
            let teacher = task.teacher.as_ref();
            teacher.map(|teacher| json!({"name": teacher.name, "blake3": teacher.hash}))
        };
        let start = self
            .start
            .as_ref()
            .map(|start| json!({"name": start.name, "blake3": start.hash, "steps": start.steps}));
        json!({
            "tasks": self.tasks.iter().map(|task| task.definition.name).collect::<Vec<_>>(),
            "environments": self.tasks.iter().map(|task| task.environments).collect::<Vec<_>>(),
            "teachers": self.tasks.iter().map(teacher).collect::<Vec<_>>(),
            "recipe": self.recipe,
            "seed": self.seed,
            "num_steps": self.total_steps,
            "start": start,
        })
    }
}

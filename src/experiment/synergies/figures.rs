//! Figures of components and synergies: one panel per task, and one of their mean.

use crate::figure::palette::{BLUE, GREY, RED};
use crate::figure::{
    ComponentFigure, ComponentPanel, ComponentSeries, LineKind, Provenance, Scale,
};
use crate::record::SubspacePoint;
use crate::sim::tasks;

use super::curves::{Line, mean_line};
use super::published::{names_policy, rings};
use super::{Scope, Synergies};

/// Panels in a row.
pub(super) const COLUMNS: usize = 4;

/// Figures, each with the stem of its files.
pub type Figures = Vec<(String, ComponentFigure)>;

impl Synergies {
    /// One figure per policy of the variance in components, and one of the reconstruction from synergies.
    #[must_use]
    pub fn figures(&self, published: &[SubspacePoint], provenance: &Provenance) -> Figures {
        let policies = self.policies();
        let mut figures = Figures::new();
        for (place, policy) in policies.iter().enumerate() {
            let stem = |what: &str| match policies.len() {
                1 => what.to_owned(),
                _ => format!("{what}_{}_{}", place + 1, slug(policy)),
            };
            let label = provenance.of_policy(policy).label();
            if self.plan.components {
                let drawn = Drawn {
                    lines: self.variance_lines(),
                    behind: Vec::new(),
                    method: "pca",
                    label: "Explained variance",
                    scale: Scale::Share,
                    counted: "components",
                    footer: format!("Principal components of the action means. {label}"),
                };
                figures.push((stem("variance"), self.figure(policy, &drawn, published)));
            }
            if let Some(plan) = &self.plan.synergies {
                let fits = if plan.fits == 1 {
                    "one fit".to_owned()
                } else {
                    format!("mean of {} fits", plan.fits)
                };
                let drawn = Drawn {
                    lines: self.score_lines(|row| row.r2),
                    behind: self.score_lines(|row| row.vaf),
                    method: "nmf",
                    label: "R²",
                    scale: Scale::Score,
                    counted: "synergies",
                    footer: format!("Synergies of the muscle controls, {fits} each. {label}"),
                };
                figures.push((stem("reconstruction"), self.figure(policy, &drawn, published)));
            }
        }
        figures
    }

    fn figure(&self, policy: &str, drawn: &Drawn, published: &[SubspacePoint]) -> ComponentFigure {
        let own = self.places_of(policy);
        let mut panels: Vec<ComponentPanel> = Vec::new();
        let mut has_published = false;
        for &task in &own {
            let name = &self.tasks[task].task;
            let mut series: Vec<ComponentSeries> = Vec::new();
            for line in drawn.behind.iter().filter(|line| line.task == task) {
                series.push(line.series(LineKind::Dashed));
            }
            for line in drawn.lines.iter().filter(|line| line.task == task) {
                series.push(line.series(LineKind::Solid));
                let basis = published.iter().map(|point| point.basis_policy.as_str());
                let basis = basis.into_iter().find(|basis| names_policy(policy, basis));
                if let Some(basis) = basis {
                    let rings = rings(published, drawn.method, line.scope, basis, name);
                    has_published |= !rings.points.is_empty();
                    series.push(rings);
                }
            }
            panels.push(drawn.panel(paper_name(name), series));
        }
        if self.has_mean(policy) {
            let mut series = Vec::new();
            for (lines, kind) in
                [(&drawn.behind, LineKind::Dashed), (&drawn.lines, LineKind::Solid)]
            {
                for scope in [Scope::Task, Scope::Pooled] {
                    series.extend(mean_line(lines, &own, scope).map(|line| line.series(kind)));
                }
            }
            let title = format!("Mean of {} tasks", panels.len());
            panels.push(drawn.panel(title, series));
        }
        let mut legend = vec![("Task-specific".to_owned(), BLUE, LineKind::Solid)];
        if drawn.lines.iter().any(|line| line.scope == Scope::Pooled) {
            legend.push(("Pooled".to_owned(), RED, LineKind::Solid));
        }
        if !drawn.behind.is_empty() {
            legend.push(("Variance accounted for (about zero)".to_owned(), GREY, LineKind::Dashed));
        }
        if has_published {
            legend.push(("Published".to_owned(), GREY, LineKind::Rings));
        }
        let (counted, footer) = (drawn.counted, drawn.footer.clone());
        ComponentFigure { panels, columns: COLUMNS, counted, legend, footer }
    }
}

/// What a figure shows.
struct Drawn {
    lines: Vec<Line>,
    /// Dashed.
    behind: Vec<Line>,
    method: &'static str,
    label: &'static str,
    scale: Scale,
    counted: &'static str,
    footer: String,
}

impl Drawn {
    fn panel(&self, title: String, series: Vec<ComponentSeries>) -> ComponentPanel {
        ComponentPanel { title, label: self.label.to_owned(), scale: self.scale, series }
    }
}

impl Line {
    pub(super) fn series(&self, kind: LineKind) -> ComponentSeries {
        let points = self.points.clone();
        ComponentSeries { colour: colour(self.scope), kind, points, band: Vec::new() }
    }
}

pub(super) fn colour(scope: Scope) -> &'static str {
    match scope {
        Scope::Task => BLUE,
        Scope::Pooled => RED,
    }
}

pub(super) fn paper_name(task: &str) -> String {
    tasks::find(task).map_or(task, |task| task.paper_name).to_owned()
}

/// A part of a file's name.
fn slug(policy: &str) -> String {
    let letter = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    policy.chars().take(40).map(letter).collect()
}

//! How the viewer arranges an act: a take has its body above its heat map, and its signals to the right; of several takes
//! every one has a column, with its signals below.
//!
//! Rerun's own builder draws random names for views and containers. Here they are counted, so that equal acts give equal
//! bytes.

use re_sdk::log::LogMsg;
use re_sdk::{ApplicationId, AsComponents, EntityPath, StoreId, StoreKind};
use re_sdk_types::blueprint::archetypes::{
    Background, ContainerBlueprint, EyeControls3D, LineGrid3D, PanelBlueprint, PlotLegend,
    ScalarAxis, TimeAxis, TimePanelBlueprint, ViewBlueprint, ViewContents, ViewportBlueprint,
    VisualBounds2D,
};
use re_sdk_types::blueprint::components::{
    BackgroundKind, ColumnShare, ContainerKind, Corner2D, Eye3DKind, IncludedContent, LoopMode,
    PanelState, PlayState, PlaybackSpeed, QueryExpression, RootContainer, RowShare, TimeRange,
    TimelineName, ViewClass,
};
use re_sdk_types::components::{Color, Name, Position3D, Range1D, Visible};
use re_sdk_types::datatypes::{self, Bool, Float32, Float64, TimeInt, TimeRangeBoundary, Uuid};

use super::heat::Map;
use super::script::{Act, Take};
use super::signals::{Scale, Signal};
use super::store::{SceneError, Store, TIME, blueprint_time};
use super::{heat, seconds, stage};

/// Plots with more lines than this have no legend: it would hide them. One line needs none.
const LEGENDS: std::ops::RangeInclusive<usize> = 2..=4;
/// Height of the plot of a flag; that of others is at least 1.
const FLAG_HEIGHT: f32 = 0.7;
/// Height that a legend needs for itself, and for each of its lines.
const LEGEND_HEIGHTS: [f32; 2] = [0.4, 0.34];
/// Between two lines of the floor, m.
const FLOOR_SPACING: f32 = 0.5;

/// All messages of the blueprint of `act`.
pub(super) fn messages(act: &Act) -> Result<Vec<LogMsg>, SceneError> {
    let id = StoreId::new(
        StoreKind::Blueprint,
        ApplicationId::new_or_unknown(act.task.as_str()),
        format!("{} layout", act.task),
    );
    let mut plan = Plan { store: Store::new(id), count: 0 };
    let map = |take: &Take| Map::new(take.stage.muscles.len(), act.length(), act.takes.len());
    let time = TimeAxis::new().with_view_range(episode(act));
    let notes = plan.view("TextDocument", "Notes", &EntityPath::from("notes"), &[])?;
    let root = if let [take] = act.takes.as_slice() {
        let body = [plan.scene(take)?, plan.map(take, map(take))?];
        let body = plan.container(ContainerKind::Vertical, &take.label, &body, &[2.8, 1.0])?;
        let (plots, heights) = plan.plots(take, &time)?;
        let plots = plan.container(ContainerKind::Vertical, "Signals", &plots, &heights)?;
        let beside = [plots, notes];
        let beside = plan.container(ContainerKind::Tabs, "Signals and notes", &beside, &[])?;
        plan.container(ContainerKind::Horizontal, &act.task, &[body, beside], &[2.0, 1.6])?
    } else {
        let mut columns = Vec::new();
        for take in &act.takes {
            let (scene, map) = (plan.scene(take)?, plan.map(take, map(take))?);
            let signals = plan.two_columns(take, &time)?;
            let parts = [scene, map, signals];
            let parts =
                plan.container(ContainerKind::Vertical, &take.label, &parts, &[2.0, 1.0, 2.2])?;
            columns.push(parts);
        }
        let shares = vec![1.0; columns.len()];
        let takes = plan.container(ContainerKind::Horizontal, "Side by side", &columns, &shares)?;
        plan.container(ContainerKind::Tabs, &act.task, &[takes, notes], &[])?
    };
    plan.finish(&root)
}

/// The time from the start of an episode to where it is cut off at the latest: what is known before steps begins and ends
/// a step earlier than what is known after them, and would stand askew above it. (Linking the axes would do the same to them:
/// the viewer then looks at the data alone.)
fn episode(act: &Act) -> TimeRange {
    let end = (seconds(act.length() - 1, act.interval) * 1e9).round() as i64;
    let at = |time| TimeRangeBoundary::Absolute(TimeInt(time));
    TimeRange(datatypes::TimeRange { start: at(0), end: at(end) })
}

/// Height of the plot of `signal`, which must have room for its legend.
fn height(signal: &Signal) -> f32 {
    let lines = signal.elements.len();
    if signal.scale == Scale::Flag {
        FLAG_HEIGHT
    } else if LEGENDS.contains(&lines) {
        let [alone, line] = LEGEND_HEIGHTS;
        (alone + line * lines as f32).max(1.0)
    } else {
        1.0
    }
}

/// A view or a container.
struct Part {
    path: String,
    number: u64,
}

struct Plan {
    store: Store,
    count: u64,
}

impl Plan {
    fn say(&mut self, path: &str, what: &dyn AsComponents) -> Result<(), SceneError> {
        self.store.row(path, blueprint_time(), what)
    }

    fn part(&mut self, kind: &str) -> Part {
        self.count += 1;
        let number = self.count;
        Part { path: format!("{kind}/00000000-0000-4000-8000-{number:012x}"), number }
    }

    /// A view of `class` on what is below `origin`, with properties.
    fn view(
        &mut self,
        class: &str,
        title: &str,
        origin: &EntityPath,
        properties: &[(&str, &dyn AsComponents)],
    ) -> Result<Part, SceneError> {
        let part = self.part("view");
        // What is drawn in the plane has no place among bodies.
        let left_out = ["- $origin/muscles_by_time/**", "- $origin/signals/**"];
        let left_out = left_out.into_iter().filter(|_| class == "3D");
        let contents = std::iter::once("+ $origin/**").chain(left_out);
        let contents = contents.map(|query| QueryExpression(query.into()));
        let contents = ViewContents::new(contents);
        self.say(&format!("{}/ViewContents", part.path), &contents)?;
        let view = ViewBlueprint::new(ViewClass(class.into()))
            .with_display_name(Name(title.into()))
            .with_space_origin(origin.to_string());
        self.say(&part.path, &view)?;
        for (name, what) in properties {
            self.say(&format!("{}/{name}", part.path), *what)?;
        }
        Ok(part)
    }

    fn container(
        &mut self,
        kind: ContainerKind,
        title: &str,
        contents: &[Part],
        shares: &[f32],
    ) -> Result<Part, SceneError> {
        let part = self.part("container");
        let paths = contents.iter().map(|part| IncludedContent(part.path.as_str().into()));
        let container = ContainerBlueprint::new(kind)
            .with_display_name(Name(title.into()))
            .with_contents(paths);
        let shares = shares.iter().map(|&share| Float32(share));
        let container = match kind {
            ContainerKind::Vertical => container.with_row_shares(shares.map(RowShare)),
            ContainerKind::Horizontal => container.with_col_shares(shares.map(ColumnShare)),
            _ => container,
        };
        self.say(&part.path, &container)?;
        Ok(part)
    }

    /// The body, from where it is best seen.
    fn scene(&mut self, take: &Take) -> Result<Part, SceneError> {
        let mut eye = EyeControls3D::new()
            .with_kind(Eye3DKind::Orbital)
            .with_position(Position3D::from(take.stage.eye))
            .with_look_target(Position3D::from(take.stage.look_at))
            .with_eye_up([0.0, 0.0, 1.0]);
        if let Some(body) = take.stage.follow {
            let path = stage::body_path(&take.path(), &take.stage, body);
            eye = eye.with_tracking_entity(path.to_string());
        }
        let background =
            Background::new(BackgroundKind::SolidColor).with_color(Color::from_rgb(24, 26, 31));
        let grid = LineGrid3D::new()
            .with_visible(Visible(Bool(take.stage.floor)))
            .with_spacing(FLOOR_SPACING)
            .with_color(Color::from_unmultiplied_rgba(160, 160, 170, 40));
        self.view(
            "3D",
            &take.label,
            &take.path(),
            &[("EyeControls3D", &eye), ("Background", &background), ("LineGrid3D", &grid)],
        )
    }

    /// The heat map with the names of its rows.
    fn map(&mut self, take: &Take, map: Map) -> Result<Part, SceneError> {
        let (x, y) = map.bounds();
        let seen =
            datatypes::Range2D { x_range: datatypes::Range1D(x), y_range: datatypes::Range1D(y) };
        let bounds = VisualBounds2D::new(seen);
        let path = heat::path(&take.path());
        self.view("2D", &map.title(), &path, &[("VisualBounds2D", &bounds)])
    }

    /// One quantity over the `time` that all plots show.
    fn plot(&mut self, take: &Take, signal: &Signal, time: &TimeAxis) -> Result<Part, SceneError> {
        let legend = PlotLegend::new()
            .with_visible(Visible(Bool(LEGENDS.contains(&signal.elements.len()))))
            .with_corner(Corner2D::RightTop);
        let axis = match signal.scale.range() {
            Some(range) => ScalarAxis::new().with_range(Range1D(datatypes::Range1D(range))),
            None => ScalarAxis::new(),
        };
        let properties: [(&str, &dyn AsComponents); 3] =
            [("PlotLegend", &legend), ("TimeAxis", time), ("ScalarAxis", &axis)];
        self.view("TimeSeries", &signal.title, &signal.path(&take.path()), &properties)
    }

    /// A plot for every quantity, and their heights.
    fn plots(&mut self, take: &Take, time: &TimeAxis) -> Result<(Vec<Part>, Vec<f32>), SceneError> {
        let plots = take.signals.iter().map(|signal| self.plot(take, signal, time));
        let plots = plots.collect::<Result<_, _>>()?;
        Ok((plots, take.signals.iter().map(height).collect()))
    }

    /// The same from top to bottom in two columns.
    fn two_columns(&mut self, take: &Take, time: &TimeAxis) -> Result<Part, SceneError> {
        let (mut left, mut heights) = self.plots(take, time)?;
        let middle = left.len().div_ceil(2);
        let (right, lower) = (left.split_off(middle), heights.split_off(middle));
        let left = self.container(ContainerKind::Vertical, "Signals", &left, &heights)?;
        if right.is_empty() {
            return Ok(left);
        }
        let right = self.container(ContainerKind::Vertical, "More signals", &right, &lower)?;
        self.container(ContainerKind::Horizontal, "All signals", &[left, right], &[1.0, 1.0])
    }

    /// The frame around it, and the end.
    fn finish(mut self, root: &Part) -> Result<Vec<LogMsg>, SceneError> {
        let mut id = [0_u8; 16];
        id[6] = 0x40;
        id[8] = 0x80;
        id[8..].iter_mut().zip(root.number.to_be_bytes()).for_each(|(into, from)| *into |= from);
        let viewport = ViewportBlueprint::new()
            .with_root_container(RootContainer(Uuid { bytes: id }))
            .with_auto_layout(Bool(false))
            .with_auto_views(Bool(false));
        self.say("viewport", &viewport)?;
        let closed = PanelBlueprint::new().with_state(PanelState::Collapsed);
        self.say("blueprint_panel", &closed)?;
        self.say("selection_panel", &closed)?;
        let time = TimePanelBlueprint::new()
            .with_state(PanelState::Collapsed)
            .with_timeline(TimelineName(TIME.into()))
            .with_playback_speed(PlaybackSpeed(Float64(0.5)))
            .with_play_state(PlayState::Playing)
            .with_loop_mode(LoopMode::All);
        self.say("time_panel", &time)?;
        self.store.activate();
        Ok(self.store.take())
    }
}

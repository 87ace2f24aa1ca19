//! Axes: from values to positions, round ticks, spines at the left and the bottom and, if asked for, the right.

use super::canvas::{Anchor, Area, Canvas, Point, Stroke, TextStyle};
use super::fonts::SMALL_SIZE;
use super::palette::BLACK;

/// Width of spines and ticks, pt.
const SPINE: f64 = 0.6;
/// Length of a tick, pt.
const TICK: f64 = 2.2;
/// Between a tick and its label, pt.
const GAP: f64 = 1.8;

/// One direction of a panel: its limits and where its ticks are.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Axis {
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) ticks: Vec<f64>,
}

impl Axis {
    /// From zero to at least `high`, with up to `intervals` round steps that end at a tick.
    pub(super) fn from_zero(high: f64, intervals: usize) -> Self {
        let high = if high.is_finite() && high > 0.0 { high } else { 1.0 };
        let step = round_step(high / intervals as f64);
        // A value that reaches a tick up to rounding needs no further one.
        let count = (high / step - 1e-9).ceil().max(1.0);
        let ticks: Vec<f64> = (0..=count as usize).map(|i| i as f64 * step).collect();
        Self { low: 0.0, high: count * step, ticks }
    }

    /// From at most `low` to at least `high`, through zero, with round ticks at both ends.
    pub(super) fn through_zero(low: f64, high: f64, intervals: usize) -> Self {
        let sane = |x: f64| if x.is_finite() { x } else { 0.0 };
        let (low, high) = (sane(low).min(0.0), sane(high).max(0.0));
        let span = high - low;
        let step = if span > 0.0 { round_step(span / intervals as f64) } else { 1.0 };
        let below = (-low / step - 1e-9).ceil().max(0.0);
        let above = (high / step - 1e-9).ceil().max(f64::from(below < 1.0));
        let count = (below + above) as usize;
        let ticks: Vec<f64> = (0..=count).map(|i| (i as f64 - below) * step).collect();
        Self { low: -below * step, high: above * step, ticks }
    }

    /// From zero to at least `high` things, which are counted in whole steps.
    pub(super) fn of_whole_numbers(high: f64, intervals: usize) -> Self {
        let axis = Self::from_zero(high, intervals);
        let step = axis.ticks[1];
        if step.fract() == 0.0 {
            return axis;
        }
        // Of the round steps only 2.5 and those below one have a fraction.
        let step = if step > 1.0 { 5.0 } else { 1.0 };
        let count = (high / step - 1e-9).ceil().max(1.0);
        let ticks: Vec<f64> = (0..=count as usize).map(|i| i as f64 * step).collect();
        Self { low: 0.0, high: count * step, ticks }
    }

    /// Cut off at `end`, with the ticks up to there; an axis that ends before stays.
    pub(super) fn ending_at(mut self, end: f64) -> Self {
        self.ticks.retain(|&tick| tick <= end * (1.0 + 1e-9));
        self.high = self.high.min(end);
        self
    }

    /// From 1 to `largest` components, both with a tick, with some room on either side.
    pub(super) fn of_counts(largest: usize) -> Self {
        let largest = largest.max(1) as f64;
        let step = if largest <= 8.0 { 1.0 } else { round_step(largest / 4.0).max(1.0) };
        let mut ticks = vec![1.0];
        let mut tick = if largest <= 8.0 { 2.0 } else { step };
        // A tick too near to the last would run into it.
        while tick <= largest - 0.6 * step {
            ticks.push(tick);
            tick += step;
        }
        if largest > 1.0 {
            ticks.push(largest);
        }
        let room = (0.03 * (largest - 1.0)).max(0.15);
        Self { low: 1.0 - room, high: largest + room, ticks }
    }

    /// Share of the way from low to high.
    fn share(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    /// The labels of the ticks, all with the decimals that the finest of them needs.
    pub(super) fn labels(&self) -> Vec<String> {
        let places = (0..6)
            .find(|&places| {
                let scale = 10_f64.powi(places);
                self.ticks.iter().all(|tick| (tick * scale - (tick * scale).round()).abs() < 1e-6)
            })
            .unwrap_or(6);
        let label = |tick: &f64| format!("{tick:.*}", places as usize).replace('-', "−");
        self.ticks.iter().map(label).collect()
    }
}

/// The smallest of 1, 2, 2.5, 5 and their multiples by ten that is not below `step`.
fn round_step(step: f64) -> f64 {
    let magnitude = 10_f64.powf(step.log10().floor());
    let factors = [1.0, 2.0, 2.5, 5.0, 10.0];
    factors
        .map(|factor| factor * magnitude)
        .into_iter()
        .find(|s| *s >= step * (1.0 - 1e-9))
        .unwrap_or(step)
}

/// Where the data of a panel are drawn, with its two axes.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub(super) area: Area,
    pub(super) x: Axis,
    pub(super) y: Axis,
}

impl Frame {
    pub(super) fn x_at(&self, value: f64) -> f64 {
        self.area.left + self.x.share(value) * self.area.width
    }

    pub(super) fn y_at(&self, value: f64) -> f64 {
        y_in(&self.area, &self.y, value)
    }

    pub(super) fn at(&self, x: f64, y: f64) -> Point {
        (self.x_at(x), self.y_at(y))
    }

    /// The left spine with ticks, and their labels if wanted.
    pub(super) fn draw_left(&self, canvas: &mut Canvas, with_labels: bool) {
        draw_vertical(canvas, &self.area, &self.y, Side::Left, with_labels);
    }

    /// The right spine of another vertical axis.
    pub(super) fn draw_right(&self, canvas: &mut Canvas, axis: &Axis, with_labels: bool) {
        draw_vertical(canvas, &self.area, axis, Side::Right, with_labels);
    }

    /// The bottom spine with ticks and labels.
    pub(super) fn draw_bottom(&self, canvas: &mut Canvas) {
        let bottom = self.area.bottom();
        self.draw_baseline(canvas);
        // Clear of the lowest label of the vertical axis.
        let baseline = bottom + TICK + GAP + 0.9 * SMALL_SIZE;
        for (&tick, label) in self.x.ticks.iter().zip(self.x.labels()) {
            let x = self.x_at(tick);
            canvas.line((x, bottom), (x, bottom + TICK), Stroke::solid(BLACK, SPINE));
            canvas.text((x, baseline), &label, TextStyle::new(SMALL_SIZE, Anchor::Middle));
        }
    }

    /// The bottom spine alone.
    pub(super) fn draw_baseline(&self, canvas: &mut Canvas) {
        let bottom = self.area.bottom();
        // Spines overlap at the corner, so that it is not notched.
        let (left, right) = (self.area.left - SPINE / 2.0, self.area.right() + SPINE / 2.0);
        canvas.line((left, bottom), (right, bottom), Stroke::solid(BLACK, SPINE));
    }
}

/// How wide the widest label of a vertical axis and its tick are, pt.
pub(super) fn label_room(axis: &Axis) -> f64 {
    let widths = axis.labels().into_iter().map(|l| super::fonts::text_width(&l, SMALL_SIZE, false));
    widths.fold(0.0, f64::max) + TICK + GAP
}

/// How high tick and label of a horizontal axis are, pt.
pub(super) fn label_height() -> f64 {
    TICK + GAP + SMALL_SIZE
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

fn draw_vertical(canvas: &mut Canvas, area: &Area, axis: &Axis, side: Side, with_labels: bool) {
    let (x, outward, anchor) = match side {
        Side::Left => (area.left, -1.0, Anchor::End),
        Side::Right => (area.right(), 1.0, Anchor::Start),
    };
    let stroke = Stroke::solid(BLACK, SPINE);
    canvas.line((x, area.bottom()), (x, area.top), stroke);
    for (&tick, label) in axis.ticks.iter().zip(axis.labels()) {
        let y = y_in(area, axis, tick);
        canvas.line((x, y), (x + outward * TICK, y), stroke);
        if with_labels {
            let position = (x + outward * (TICK + GAP), y + 0.36 * SMALL_SIZE);
            canvas.text(position, &label, TextStyle::new(SMALL_SIZE, anchor));
        }
    }
}

pub(super) fn y_in(area: &Area, axis: &Axis, value: f64) -> f64 {
    area.bottom() - axis.share(value) * area.height
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_reach_the_data() {
        let axis = Axis::from_zero(1.0, 4);
        assert_eq!(axis.labels(), ["0.00", "0.25", "0.50", "0.75", "1.00"]);
        assert_eq!(Axis::from_zero(1.0, 2).labels(), ["0.0", "0.5", "1.0"]);
        assert_eq!(Axis::from_zero(121.3, 3).labels(), ["0", "50", "100", "150"]);
        for odd in [f64::NAN, 0.0, -3.0, f64::INFINITY] {
            assert_eq!(Axis::from_zero(odd, 2).high.to_bits(), 1.0_f64.to_bits());
        }
    }

    #[test]
    fn things_are_counted_in_whole_steps_and_an_axis_may_be_cut() {
        assert_eq!(Axis::of_whole_numbers(11.5, 5).labels(), ["0", "5", "10", "15"]);
        assert_eq!(Axis::of_whole_numbers(5.0, 2).labels(), ["0", "5"]);
        assert_eq!(Axis::of_whole_numbers(2.0, 5).labels(), ["0", "1", "2"]);
        assert_eq!(Axis::of_whole_numbers(40.0, 2).labels(), ["0", "20", "40"]);
        let cut = Axis::from_zero(151.0, 5).ending_at(155.0);
        assert_eq!((cut.labels().join(" "), cut.high), ("0 50 100 150".to_owned(), 155.0));
        assert_eq!(Axis::from_zero(1.0, 5).ending_at(3.0), Axis::from_zero(1.0, 5));
    }

    #[test]
    fn an_axis_through_zero_reaches_both_ends() {
        assert_eq!(Axis::through_zero(-21.3, -12.0, 4).labels(), ["−30", "−20", "−10", "0"]);
        assert_eq!(Axis::through_zero(0.0, 3.2, 4).labels(), ["0", "1", "2", "3", "4"]);
        assert_eq!(Axis::through_zero(f64::NAN, f64::NAN, 4).labels(), ["0", "1"]);
        assert_eq!(
            Axis::through_zero(-1.0, 1.0, 4).labels(),
            ["−1.0", "−0.5", "0.0", "0.5", "1.0"]
        );
    }

    #[test]
    fn component_ticks_hold_both_ends_and_do_not_collide() {
        let labels = |largest| Axis::of_counts(largest).labels().join(" ");
        assert_eq!(labels(1), "1");
        assert_eq!(labels(6), "1 2 3 4 5 6");
        assert_eq!(labels(39), "1 10 20 30 39");
        assert_eq!(labels(63), "1 20 40 63");
        assert_eq!(labels(80), "1 20 40 60 80");
    }
}

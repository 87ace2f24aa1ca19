//! Light for print, dark for slides: a finished drawing in other colours.
//!
//! A drawing names its colours as `#RRGGBB`. On dark paper black and white change places, and greys between them: faint ones
//! stand back a little less there, because a thin light line on dark paper looks thinner than a dark one on white. A colour
//! is mixed with white: three sixteenths of it, and as many more as its contrast with the paper (WCAG 2: the ratio of
//! relative luminances, each plus 0.05) needs to be at least 3, which is what lines and bars need to be told from their
//! ground. Hues stay, so a policy keeps its colour from paper to slide, and a scale of shades keeps its order.

use super::palette::{BLACK, GREY, WHITE};

/// Paper of a slide.
const DARK_PAPER: &str = "#15171C";
/// Text and axes on it.
const DARK_INK: &str = "#ECECEC";
/// What stands back on it.
const DARK_GREY: &str = "#A7A9AE";
/// Least contrast of a line with its ground.
const LEAST_CONTRAST: f64 = 3.0;
/// Red, green and blue of a grey differ by no more than this.
const GREYEST: u16 = 6;
/// Power of the share of ink in a grey.
const FAINT: f64 = 0.8;
/// Steps from a colour to white, and those that every colour takes.
const STEPS: u16 = 16;
const LEAST_STEPS: u16 = 3;

/// What a figure is made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Theme {
    /// Dark on white, for print.
    #[default]
    Light,
    /// Light on nearly black, for slides.
    Dark,
}

impl Theme {
    /// A drawing in this theme's colours.
    #[must_use]
    pub fn apply(self, svg: &str) -> String {
        // In a drawing a colour is a whole attribute, and text holds no quotation mark.
        const START: &str = "=\"#";
        if self == Self::Light {
            return svg.to_owned();
        }
        let mut drawn = String::with_capacity(svg.len());
        let mut rest = svg;
        while let Some(at) = rest.find(START) {
            let (before, colour) = rest.split_at(at + START.len() - 1);
            drawn.push_str(before);
            let end = colour.find('"').unwrap_or(colour.len());
            drawn.push_str(&self.colour(&colour[..end]));
            rest = &colour[end..];
        }
        drawn.push_str(rest);
        drawn
    }

    /// What a colour becomes. What is no `#RRGGBB` stays.
    #[must_use]
    pub fn colour(self, colour: &str) -> String {
        let fixed = [(BLACK, DARK_INK), (WHITE, DARK_PAPER), (GREY, DARK_GREY)];
        if self == Self::Light {
            return colour.to_owned();
        }
        if let Some((_, dark)) = fixed.iter().find(|(light, _)| light.eq_ignore_ascii_case(colour))
        {
            return (*dark).to_owned();
        }
        let (Some(colour_parts), Some(paper), Some(ink)) =
            (parts(colour), parts(DARK_PAPER), parts(DARK_INK))
        else {
            return colour.to_owned();
        };
        let brightest = colour_parts.into_iter().fold(0, u16::max);
        if colour_parts.iter().all(|part| brightest - part <= GREYEST) {
            let share = (1.0 - f64::from(brightest) / 255.0).powf(FAINT);
            let between =
                |at: usize| paper[at] + (f64::from(ink[at] - paper[at]) * share).round() as u16;
            return written([between(0), between(1), between(2)]);
        }
        let mixed = |step: u16| colour_parts.map(|part| part + (255 - part) * step / STEPS);
        let found = (LEAST_STEPS..=STEPS)
            .map(mixed)
            .find(|&mixed| contrast(mixed, paper) >= LEAST_CONTRAST);
        written(found.unwrap_or([255; 3]))
    }
}

fn written([red, green, blue]: [u16; 3]) -> String {
    format!("#{red:02X}{green:02X}{blue:02X}")
}

/// Red, green and blue, 0 to 255.
fn parts(colour: &str) -> Option<[u16; 3]> {
    let digits =
        colour.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii())?;
    let part = |at: usize| u16::from_str_radix(&digits[at..at + 2], 16).ok();
    Some([part(0)?, part(2)?, part(4)?])
}

fn contrast(one: [u16; 3], two: [u16; 3]) -> f64 {
    let (one, two) = (luminance(one), luminance(two));
    (one.max(two) + 0.05) / (one.min(two) + 0.05)
}

/// Relative luminance, 0 to 1.
fn luminance(colour: [u16; 3]) -> f64 {
    let linear = |part: u16| {
        let share = f64::from(part) / 255.0;
        if share <= 0.040_45 { share / 12.92 } else { ((share + 0.055) / 1.055).powf(2.4) }
    };
    let [red, green, blue] = colour.map(linear);
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

#[cfg(test)]
mod tests {
    use super::super::palette::{BLUE, RED, group_colours, method_colours, policy_colours};
    use super::*;

    #[test]
    fn every_colour_of_the_palette_is_seen_on_dark_paper_and_none_becomes_anothers() {
        let names = ["arnold", "obc", "bc", "ppo_t_sv", "mt_sac", "expert", "a", "b"];
        let palettes = [method_colours(&names), policy_colours(&names[..4]), group_colours(8)];
        let paper = parts(DARK_PAPER).unwrap();
        for palette in palettes {
            let dark: Vec<String> = palette.iter().map(|c| Theme::Dark.colour(c)).collect();
            for colour in &dark {
                assert!(contrast(parts(colour).unwrap(), paper) >= LEAST_CONTRAST, "{colour}");
            }
            let count = |colours: &[String]| {
                colours.iter().collect::<std::collections::BTreeSet<_>>().len()
            };
            let light: Vec<String> = palette.iter().map(|colour| (*colour).to_owned()).collect();
            assert_eq!(count(&dark), count(&light));
        }
        // A faint line stays faint, a strong one strong.
        assert_eq!(
            ["#000000", "#DDDDDD"].map(|grey| Theme::Dark.colour(grey)),
            ["#ECECEC", "#404145"]
        );
        // The sizes of the network, from light to dark.
        let shades =
            ["#64B5CD", "#4C92B0", "#3B6A94", "#2B4470"].map(|shade| Theme::Dark.colour(shade));
        let parts = shades.map(|shade| parts(&shade).unwrap());
        assert!(parts.is_sorted_by(|a, b| luminance(*a) > luminance(*b) && contrast(*a, *b) > 1.2));
    }

    #[test]
    fn only_colours_change_and_light_is_the_drawing_itself() {
        let svg = format!(
            r#"<rect fill="{WHITE}"/><line stroke="{RED}" clip-path="url(#clip1)"/><text fill="{BLACK}">=#123456 {BLUE}</text>"#
        );
        assert_eq!(Theme::Light.apply(&svg), svg);
        let dark = Theme::Dark.apply(&svg);
        assert!(
            dark.contains(DARK_PAPER) && dark.contains(DARK_INK) && dark.contains("url(#clip1)")
        );
        assert!(dark.contains(&format!(">=#123456 {BLUE}<")), "text stays: {dark}");
        assert_eq!(Theme::Dark.colour("none"), "none");
        assert_eq!(Theme::Dark.apply("<a b=\"#12"), "<a b=\"#12", "an open end is no colour");
    }

    #[test]
    fn luminance_is_that_of_the_standard() {
        // WCAG 2: white on black is 21, and #777777 on white is 4.48.
        assert!((contrast([255; 3], [0; 3]) - 21.0).abs() < 1e-9);
        assert!((contrast([0x77; 3], [255; 3]) - 4.478).abs() < 1e-3);
    }
}

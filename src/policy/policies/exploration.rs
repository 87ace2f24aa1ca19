//! How actor-critic policies draw their actions around the mean (`spec/policy.md` §4.3).
//!
//! With φ the latent vector before the last layer, W that layer's weight and ξ standard normal:
//!
//! * diagonal: `σ ξ`, one σ per muscle;
//! * lattice: `s ξ + W (t ξ')`, fixed scales s per muscle and t per latent component;
//! * gSDE: `φ E`, a matrix E of one σ per element, drawn anew every few steps;
//! * lattice gSDE: `φ E + α W (φ E')`, two such matrices.
//!
//! The shapes of `log_std` tell them apart, but not the settings that turn it into σ. Where no file states those, the
//! policy can only be played by its means.

use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::ExplorationSettings;
use crate::policy::network::weights::Weights;

/// Variance that gSDE adds before the root, as the library does.
const GSDE_VARIANCE: f32 = 1e-6;
/// Added inside the logarithm of "expln", as the library does.
const EXPLN_EPSILON: f32 = 1e-6;
/// Wider latent vectors would ask for more noise than any published policy by orders of magnitude.
const WIDEST_LATENT: usize = 4096;

/// Standard deviations of a policy, or that they are not known.
#[derive(Debug, Clone)]
pub(super) enum Exploration {
    Gaussian(Vec<f32>),
    Lattice { muscles: Vec<f32>, latents: Vec<f32>, weight: Vec<f32> },
    StateDependent(StateDependent),
    Unknown,
}

/// Noise that is a matrix times the latent vector.
#[derive(Debug, Clone)]
pub(super) struct StateDependent {
    width: usize,
    muscles: usize,
    /// Width × muscles.
    independent: Vec<f32>,
    /// Added to every variance.
    variance: f32,
    correlated: Option<Correlated>,
    steps_between_draws: Option<usize>,
}

/// The lattice's part of it.
#[derive(Debug, Clone)]
struct Correlated {
    /// Width × width.
    deviations: Vec<f32>,
    /// Of the last layer, muscles × width.
    weight: Vec<f32>,
    alpha: f32,
}

/// What the noise of several bodies keeps from one step to the next.
#[derive(Debug, Clone)]
pub(super) struct NoiseMemory {
    /// Slots × width.
    latents: Vec<f32>,
    /// Slots × elements of all matrices.
    matrices: Vec<f32>,
    /// For each slot, steps until its matrices are drawn anew.
    remaining: Vec<usize>,
}

impl Exploration {
    /// Reads `log_std` for the last layer `head`.
    pub(super) fn read(
        weights: Weights,
        head: &str,
        settings: Option<&ExplorationSettings>,
    ) -> Result<Self, PolicyError> {
        let [muscles, width] = weights.matrix_size(&format!("{head}.weight"))?;
        let weight = weights.tensor(&format!("{head}.weight"), &[muscles, width])?;
        let shape = weights.shape("log_std")?;
        let logarithms = weights.tensor("log_std", shape)?;
        let exponentials = |shift: f32| logarithms.iter().map(move |x| (x + shift).exp());
        let exploration = match (shape, settings) {
            (&[count], _) if count == muscles => Self::Gaussian(exponentials(0.0).collect()),
            (&[count], Some(settings)) if count == muscles + width => {
                let mut scales: Vec<f32> = exponentials(settings.log_scale as f32).collect();
                let latents = scales.split_off(muscles);
                Self::Lattice { muscles: scales, latents, weight: weight.to_vec() }
            }
            (&[rows, columns], Some(settings)) if rows == width => {
                let sizes = [width, muscles, columns];
                StateDependent::read(logarithms, sizes, weight, settings)?
                    .map_or(Self::Unknown, Self::StateDependent)
            }
            _ => Self::Unknown,
        };
        let finite = |numbers: &[f32]| numbers.iter().all(|number| number.is_finite());
        let usable = match &exploration {
            Self::Gaussian(deviations) => finite(deviations),
            Self::Lattice { muscles, latents, .. } => finite(muscles) && finite(latents),
            Self::StateDependent(noise) => noise.constants().all(finite),
            Self::Unknown => true,
        };
        if usable {
            Ok(exploration)
        } else {
            Err(PolicyError::NotFinite { name: "log_std".to_owned() })
        }
    }

    pub(super) fn is_known(&self) -> bool {
        !matches!(self, Self::Unknown)
    }

    /// Room for the noise of `slots` bodies.
    pub(super) fn memory(&self, slots: usize) -> NoiseMemory {
        let (width, elements) = match self {
            Self::StateDependent(noise) => (noise.width, noise.elements()),
            _ => (0, 0),
        };
        NoiseMemory {
            latents: vec![0.0; slots * width],
            matrices: vec![0.0; slots * elements],
            remaining: vec![0; slots],
        }
    }

    /// Fills one row with the standard deviation of every muscle, NaN if they are not known, and keeps what
    /// [`Self::sample`] needs.
    pub(super) fn write(
        &self,
        latent: &[f32],
        memory: &mut NoiseMemory,
        slot: usize,
        row: &mut [f32],
    ) {
        match self {
            Self::Gaussian(deviations) => row.copy_from_slice(&deviations[..row.len()]),
            Self::Lattice { muscles, latents, weight } => {
                for ((deviation, scale), weights) in
                    row.iter_mut().zip(muscles).zip(weight.chunks_exact(latents.len()))
                {
                    let terms = weights.iter().zip(latents).map(|(w, t)| (w * t) * (w * t));
                    *deviation = (scale * scale + terms.sum::<f32>()).sqrt();
                }
            }
            Self::StateDependent(noise) => {
                memory.latents[slot * noise.width..][..noise.width].copy_from_slice(latent);
                noise.deviations(latent, row);
            }
            Self::Unknown => row.fill(f32::NAN),
        }
    }

    /// Adds one draw of noise to the mean in `action`, right after [`Self::write`] for the same body.
    pub(super) fn sample(
        &self,
        memory: &mut NoiseMemory,
        slot: usize,
        deviations: &[f32],
        action: &mut [f32],
        normal: &mut dyn FnMut() -> f64,
    ) {
        match self {
            Self::Gaussian(_) | Self::Unknown => {
                for (action, deviation) in action.iter_mut().zip(deviations) {
                    *action += deviation * normal() as f32;
                }
            }
            Self::Lattice { muscles, latents, weight } => {
                for (action, scale) in action.iter_mut().zip(muscles) {
                    *action += scale * normal() as f32;
                }
                for (component, scale) in latents.iter().enumerate() {
                    let noise = scale * normal() as f32;
                    let column = weight.iter().skip(component).step_by(latents.len());
                    for (action, weight) in action.iter_mut().zip(column) {
                        *action += weight * noise;
                    }
                }
            }
            Self::StateDependent(noise) => noise.sample(memory, slot, action, normal),
        }
    }
}

impl NoiseMemory {
    /// The next episode draws its own noise.
    pub(super) fn reset(&mut self, slot: usize) {
        self.remaining[slot] = 0;
    }
}

impl StateDependent {
    /// `None` if no scheme has a parameter of so many columns.
    fn read(
        logarithms: &[f32],
        [width, muscles, columns]: [usize; 3],
        weight: &[f32],
        settings: &ExplorationSettings,
    ) -> Result<Option<Self>, PolicyError> {
        if width > WIDEST_LATENT {
            let what = format!("exploration over a latent vector of {width} components");
            return Err(PolicyError::Unsupported { what });
        }
        if settings.clip[0] <= 0.0 || settings.clip[1] < settings.clip[0] {
            let [low, high] = settings.clip;
            let what = format!("standard deviations between {low} and {high}");
            return Err(PolicyError::Unsupported { what });
        }
        // Two columns, or one per latent component and muscle, are the lattice's, unless they are as many as muscles.
        let lattice_shape = columns == 2 || columns == width + muscles;
        let lattice = lattice_shape && (settings.lattice || columns != muscles);
        let deviation = |logarithm: f32| {
            let logarithm = if lattice {
                let [low, high] = settings.clip.map(|bound| bound.ln() as f32);
                logarithm.max(low).min(high) - 0.5 * (width as f32).ln()
            } else {
                logarithm
            };
            if settings.expln && logarithm > 0.0 {
                (logarithm + EXPLN_EPSILON).ln_1p() + 1.0
            } else {
                logarithm.exp()
            }
        };
        let deviations: Vec<f32> = logarithms.iter().map(|&x| deviation(x)).collect();
        // Columns `from..to` of every row, or its one column as often as there are muscles or components.
        let select = |from: usize, count: usize, is_one: bool| -> Vec<f32> {
            let rows = deviations.chunks_exact(columns);
            rows.flat_map(|row| (0..count).map(move |k| row[if is_one { from } else { from + k }]))
                .collect()
        };
        let (independent, correlated) = if lattice {
            let is_one = columns == 2;
            let first_of_muscles = if is_one { 1 } else { width };
            let independent = select(first_of_muscles, muscles, is_one);
            let deviations = select(0, width, is_one);
            let alpha = settings.alpha as f32;
            (independent, Some(Correlated { deviations, weight: weight.to_vec(), alpha }))
        } else if columns == 1 || columns == muscles {
            (select(0, muscles, columns == 1), None)
        } else {
            return Ok(None);
        };
        let regulariser = settings.regulariser as f32;
        Ok(Some(Self {
            width,
            muscles,
            independent,
            variance: if lattice { regulariser * regulariser } else { GSDE_VARIANCE },
            correlated,
            steps_between_draws: settings.steps_between_draws,
        }))
    }

    /// Everything that was computed from the settings.
    fn constants(&self) -> impl Iterator<Item = &[f32]> {
        let lattice = self.correlated.iter();
        let lattice =
            lattice.flat_map(|part| [&part.deviations[..], std::slice::from_ref(&part.alpha)]);
        [&self.independent[..], std::slice::from_ref(&self.variance)].into_iter().chain(lattice)
    }

    /// Elements of all matrices.
    fn elements(&self) -> usize {
        let correlated = if self.correlated.is_some() { self.width } else { 0 };
        self.width * (correlated + self.muscles)
    }

    /// Standard deviation of every muscle's noise, drawn anew.
    fn deviations(&self, latent: &[f32], row: &mut [f32]) {
        let variance = |deviations: &[f32], columns: usize, column: usize| -> f32 {
            let along = deviations.iter().skip(column).step_by(columns);
            latent.iter().zip(along).map(|(phi, deviation)| (phi * deviation).powi(2)).sum()
        };
        for (muscle, deviation) in row.iter_mut().enumerate() {
            *deviation = self.variance + variance(&self.independent, self.muscles, muscle);
        }
        if let Some(Correlated { deviations, weight, alpha }) = &self.correlated {
            for component in 0..self.width {
                let spread = alpha * alpha * variance(deviations, self.width, component);
                let column = weight.iter().skip(component).step_by(self.width);
                for (deviation, weight) in row.iter_mut().zip(column) {
                    *deviation += weight * weight * spread;
                }
            }
        }
        for deviation in row {
            *deviation = deviation.sqrt();
        }
    }

    fn sample(
        &self,
        memory: &mut NoiseMemory,
        slot: usize,
        action: &mut [f32],
        normal: &mut dyn FnMut() -> f64,
    ) {
        let latent = &memory.latents[slot * self.width..][..self.width];
        let matrices = &mut memory.matrices[slot * self.elements()..][..self.elements()];
        let (correlated, independent) =
            matrices.split_at_mut(self.elements() - self.width * self.muscles);
        if memory.remaining[slot] == 0 {
            memory.remaining[slot] = self.steps_between_draws.unwrap_or(usize::MAX);
            let scales = self.correlated.as_ref().map_or(&[][..], |part| &part.deviations);
            for (element, scale) in correlated.iter_mut().zip(scales) {
                *element = scale * normal() as f32;
            }
            for (element, scale) in independent.iter_mut().zip(&self.independent) {
                *element = scale * normal() as f32;
            }
        }
        memory.remaining[slot] -= 1;
        let through = |matrix: &[f32], columns: usize, column: usize| -> f32 {
            let along = matrix.iter().skip(column).step_by(columns);
            latent.iter().zip(along).map(|(phi, element)| phi * element).sum()
        };
        for (muscle, action) in action.iter_mut().enumerate() {
            *action += through(independent, self.muscles, muscle);
        }
        if let Some(Correlated { weight, alpha, .. }) = &self.correlated {
            for component in 0..self.width {
                let noise = alpha * through(correlated, self.width, component);
                let column = weight.iter().skip(component).step_by(self.width);
                for (action, weight) in action.iter_mut().zip(column) {
                    *action += weight * noise;
                }
            }
        }
    }
}

//! Following a moving V: choosing and multiplying together, on one grid, with a bound for every frame.
//!
//! ```text
//! step(V):   V to the grid;   update = choose(V);   B = multiply(update);   bound(V - V~, V)
//! two stages:                 the same once more with V2 = link(B), then mix or add what nodes give
//! ```

use std::sync::Arc;
use std::time::Instant;

use crate::error::{Error, Result};
use crate::transport::Link;

use super::chain::{Chain, check_mix};
use super::change::Update;
use super::choosing::method::{Budget, Settings};
use super::multiplying::bound::{BandNorms, Measured, bound_rows, finish_bounds, largest_of_all, with_overflow};
use super::multiplying::clustered::Clustered;
use super::multiplying::finish::Mix;
use super::multiplying::grid::{Grid, light_norm};
use super::pace::Pace;
use super::stage::{Chosen, Output, Stage};

/// Of a budget in error: the rest is for what is rounded on the way.
const SPENT: f64 = 1.0 - 1.0 / 1024.0;

/// What the first frame starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Initial {
    /// The whole product (Overbeck 2006, section 4: "we compute the full matrix-vector multiply").
    Full,
    /// The largest terms of the light within the budget, whatever the method.
    Nonlinear,
    /// The first update of the method itself, from black.
    Black,
}

/// What a step did.
pub struct Step {
    /// Of the first stage.
    pub update: Update,
    /// Its place among the pictures of its follower.
    pub number: u64,
    /// No receiver is further than this from the untruncated product with the light asked for, in red, green and blue.
    pub bound: [f64; 3],
    /// What of it truncation takes: the bound once V~ is the light.
    pub truncation: [f64; 3],
    /// For each band of the first stage's V and colour the norm of what is not yet applied.
    pub remaining: BandNorms,
    /// V~ is the light, bit for bit on its grid, in all stages.
    pub converged: bool,
    /// Seconds of choosing (grid, tests, selection) and of multiplying, all stages.
    pub choosing: f64,
    /// Seconds of sending the change through M and of writing B.
    pub multiplying: f64,
}

/// One follower of the light over one chain.
pub struct Updater {
    chain: Arc<Chain>,
    first: Stage,
    /// One where all of the second stage shares a V; one for each factor where each has its own.
    second: Vec<Stage>,
    /// Of clustered transport: for each factor and cluster what the second stage has not applied.
    unsent: Vec<Vec<[f64; 3]>>,
    mix: Option<Mix>,
    initial: Option<Initial>,
    /// Whether the grid of a light follows from that light alone, whatever came before.
    steady: bool,
    /// The budget in error that was asked for: what truncation takes of it is not there to be spent.
    error: Option<f64>,
    /// What truncation took of the last frame.
    truncation: [f64; 3],
    pace: Pace,
    /// Pictures written so far.
    shown: u64,
}

impl Updater {
    /// `second`: how the second stage is followed, where there is one.
    /// `mix`: how the responses of several factors are mixed, where there are several.
    pub fn new(
        chain: Arc<Chain>,
        first: Settings,
        second: Option<Settings>,
        mix: Option<Mix>,
        initial: Initial,
    ) -> Result<Self> {
        let product = &chain.product;
        check_mix(product, mix.as_ref())?;
        let error = if let Budget::Error { tolerance, .. } = first.budget { Some(tolerance) } else { None };
        let mut stages = Vec::new();
        match (&product.then, second) {
            (None, None) => {}
            (Some(then), Some(settings)) => {
                let separate = matches!(product.link, Link::Representatives(_));
                for factors in if separate { then.each() } else { vec![then.clone()] } {
                    stages.push(Stage::new(factors, chain.then_span, settings.clone())?);
                }
            }
            (then, _) => {
                let needed = if then.is_some() { "settings for its second stage" } else { "one stage only" };
                return Err(Error::input(format!("expected {needed}")));
            }
        }
        Ok(Updater {
            first: Stage::new(product.first.clone(), chain.span, first)?,
            second: stages,
            unsent: Vec::new(),
            mix,
            initial: Some(initial),
            steady: false,
            error,
            truncation: [0.0; 3],
            pace: Pace::default(),
            shown: 0,
            chain,
        })
    }

    /// From now on a light that has been applied in full gives the bits that it gives a new follower: its grid follows from
    /// it alone, in steps of 2^4. A light that grows or fades over such a step is applied afresh, which costs a product.
    pub fn steady(self) -> Self {
        Updater { steady: true, ..self }
    }

    /// Mixes the responses of the last frame anew, from now on: another view, or another BRDF. Nothing is sent for it.
    pub fn remix(&mut self, mix: Mix, out: &mut [f32]) -> Result<Step> {
        let started = Instant::now();
        self.check_room(out)?;
        check_mix(&self.chain.product, Some(&mix))?;
        if self.first.outputs().any(|output| output.measured.is_none()) {
            return Err(Error::input("expected a frame to mix anew: call step first"));
        }
        if let Budget::Error { tolerance, .. } = self.first.budget() {
            let factors = self.chain.error_factors(Some(&mix));
            self.first.set_budget(Budget::Error { tolerance: *tolerance, factors })?;
        }
        self.mix = Some(mix);
        self.write(out);
        Ok(self.shown(out, Update::default(), 0.0, started.elapsed().as_secs_f64()))
    }

    /// Moves towards `light` (columns x 3) and writes B (rows x 3). A light that is refused leaves everything as it was.
    pub fn step(&mut self, light: &[[f64; 3]], out: &mut [f32]) -> Result<Step> {
        self.frame(light, out, None, &Chosen::Own)
    }

    /// V~, from which somebody else may choose what is sent towards `light`; None where it is settled what the first frame
    /// takes. A light that is refused here would be refused by `frame`.
    pub fn prepare(&self, light: &[[f64; 3]]) -> Result<Option<&[[f64; 3]]>> {
        self.first.check(light)?;
        let settled = matches!(self.initial, Some(Initial::Full | Initial::Nonlinear));
        Ok((!settled).then(|| self.first.values()))
    }

    /// A step by the method itself, or by what somebody else has chosen.
    pub fn frame(
        &mut self,
        light: &[[f64; 3]],
        out: &mut [f32],
        seconds: Option<f64>,
        chosen: &Chosen,
    ) -> Result<Step> {
        let started = Instant::now();
        self.check_room(out)?;
        if let Chosen::Given { resets, columns } = chosen {
            self.first.check_choice(resets, columns)?;
        }
        self.spare_truncation(light)?;
        if self.steady {
            let grid = Grid::for_second(light_norm(light), 1.0, self.chain.span)?;
            self.first.receive_on(grid, light)?;
        } else {
            self.first.receive(light)?;
        }
        let settled = started.elapsed().as_secs_f64();
        if let Some(seconds) = seconds {
            // A budget of nothing would change nothing, for ever.
            let cost = self.pace.affordable(seconds - settled).max(f64::MIN_POSITIVE);
            self.first.set_budget(Budget::Cost(cost))?;
        }
        let chosen = match self.initial {
            Some(Initial::Full) => &Chosen::Whole,
            Some(Initial::Nonlinear) => &Chosen::Largest,
            Some(Initial::Black) | None => chosen,
        };
        let update = self.first.choose(chosen)?;
        let whole = self.initial.take() == Some(Initial::Full);
        let choosing = started.elapsed().as_secs_f64();

        // One matrix in the last stage writes its rows while their sums are at hand.
        let alone = self.outputs().len() == 1 && self.mix.is_none();
        let mut rows = if alone { Some(&mut *out) } else { None };
        self.first.multiply(&update, rows.take_if(|_| self.second.is_empty()))?;
        self.first.measure(light, None);
        if !self.second.is_empty() {
            self.follow(if whole { &Chosen::Whole } else { &Chosen::Own }, rows)?;
        }
        if !alone {
            self.write(out);
        }
        let multiplying = started.elapsed().as_secs_f64() - choosing;

        let step = self.shown(out, update, choosing, multiplying);
        if seconds.is_some() && !whole {
            self.pace.learn(self.first.streamed(), started.elapsed().as_secs_f64() - settled);
        }
        Ok(step)
    }

    /// Lowers a budget in error by what truncation takes under a light, and refuses one that is all taken from the first.
    ///
    /// A light that grows too bright later is followed as closely as the budget says, on top of what truncation takes: whoever
    /// looks on is not cut off.
    fn spare_truncation(&mut self, light: &[[f64; 3]]) -> Result<()> {
        let Some(error) = self.error else { return Ok(()) };
        self.first.check(light)?;
        let truncation = self.truncation_under(light).into_iter().fold(0.0, f64::max);
        if truncation >= error && self.initial.is_some() {
            return Err(Error::input(format!(
                "expected an error of more than {truncation:.6}, what truncation takes under this light whatever is sent, \
                 got {error}; a transport made with a smaller tolerance allows less"
            )));
        }
        let Budget::Error { factors, .. } = self.first.budget() else { return Ok(()) };
        let left = if truncation < error { SPENT * (error - truncation) } else { error };
        let budget = Budget::Error { tolerance: left, factors: factors.clone() };
        self.first.set_budget(budget)
    }

    /// What truncation takes under a light; where a second stage follows over a tree, what it took of the last frame.
    fn truncation_under(&self, light: &[[f64; 3]]) -> [f64; 3] {
        let settled = self.first.settled(light);
        let each: Vec<[f64; 3]> = if !self.chain.clustered.is_empty() {
            let all = self.chain.clustered.iter().zip(&settled).zip(self.nothing_unsent());
            all.map(|((own, settled), unsent)| own.largest(settled, &unsent)).collect()
        } else if self.second.is_empty() {
            self.first.outputs().zip(&settled).map(|(output, settled)| output.bound.largest(settled)).collect()
        } else {
            return self.truncation;
        };
        largest_of_all(each.into_iter().zip(self.largest_weights()))
    }

    /// What there is to say of the picture `out` that was just written.
    fn shown(&mut self, out: &[f32], update: Update, choosing: f64, multiplying: f64) -> Step {
        self.shown += 1;
        let converged = self.first.is_converged() && self.second.iter().all(Stage::is_converged);
        self.truncation = self.bound(|output| output.settled, &self.nothing_unsent());
        let remaining = self.first.outputs().next().and_then(|output| Some(output.measured?.remaining.clone()));
        Step {
            update,
            number: self.shown,
            bound: with_overflow(self.bound(|output| output.measured, &self.unsent), out),
            truncation: self.truncation,
            remaining: remaining.unwrap_or_default(),
            converged,
            choosing,
            multiplying,
        }
    }

    fn check_room(&self, out: &[f32]) -> Result<()> {
        let (rows, found) = (self.chain.product.rows(), out.len());
        if found == 3 * rows {
            return Ok(());
        }
        Err(Error::input(format!("expected room for {rows} x 3 values, got {found}")))
    }

    /// Brings the second stage after the first; `out`, rows x 3, may be given where one matrix is all of it.
    fn follow(&mut self, chosen: &Chosen, mut out: Option<&mut [f32]>) -> Result<()> {
        let grid = self.chain.second_grid(self.first.values())?;
        self.unsent.clear();
        for (factor, stage) in self.second.iter_mut().enumerate() {
            let output = self.first.outputs().nth(factor).expect("each second stage has its first");
            let light = self.chain.second_light(output.response.tiles(), factor, self.first.values());
            stage.receive_on(grid, &light)?;
            let update = stage.choose(chosen)?;
            stage.multiply(&update, out.as_deref_mut())?;
            if let Some(clustered) = self.chain.clustered.get(factor) {
                self.unsent.push(clustered.unsent(&light, stage.values()));
            } else {
                let unsure = |measured| self.chain.unsure(&bound_rows(output.matrix, measured), &light);
                let settled = output.settled.unwrap_or(measured(&output)?);
                stage.measure(&light, Some([unsure(measured(&output)?), unsure(settled)]));
            }
        }
        Ok(())
    }

    /// The last stage's matrices, and what is known of them.
    fn outputs(&self) -> Vec<Output<'_>> {
        match self.second.is_empty() {
            true => self.first.outputs().collect(),
            false => self.second.iter().flat_map(Stage::outputs).collect(),
        }
    }

    /// Writes B from what has been applied.
    fn write(&self, out: &mut [f32]) {
        let responses: Vec<_> = self.outputs().iter().map(|output| output.response.tiles()).collect();
        self.chain.finish(&responses, self.mix.as_ref(), out);
    }

    /// What each output counts for, at most, in a receiver's B.
    fn largest_weights(&self) -> Vec<f64> {
        match (&self.chain.product.link, &self.mix) {
            (Link::Weights(weights), _) => vec![1.0, weights.largest_sum()],
            (_, Some(mix)) => mix.largest().to_vec(),
            (_, None) => vec![1.0],
        }
    }

    /// The bound of all receivers in one number a colour, of the last frame, by what `of` says was measured.
    fn bound(&self, of: impl for<'a> Fn(&Output<'a>) -> Option<&'a Measured>, unsent: &[Vec<[f64; 3]>]) -> [f64; 3] {
        let each: Vec<[f64; 3]> = if self.chain.clustered.is_empty() {
            self.outputs().iter().filter_map(|output| Some(output.bound.largest(of(output)?))).collect()
        } else {
            let all = self.chain.clustered.iter().zip(self.first.outputs()).zip(unsent);
            all.filter_map(|((own, output), unsent)| Some(own.largest(of(&output)?, unsent))).collect()
        };
        largest_of_all(each.into_iter().zip(self.largest_weights()))
    }

    /// What is unsent of clusters once everything has been sent.
    fn nothing_unsent(&self) -> Vec<Vec<[f64; 3]>> {
        self.chain.clustered.iter().map(|own| vec![[0.0; 3]; own.clusters()]).collect()
    }

    /// Of clustered transport, for each factor: its bound, what has been measured of the light, and what is unsent.
    fn clustered(&self) -> impl Iterator<Item = (&Clustered, Option<&Measured>, &[[f64; 3]])> {
        let first = self.first.outputs().map(|output| output.measured);
        self.chain.clustered.iter().zip(first).zip(&self.unsent).map(|((own, of), unsent)| (own, of, &unsent[..]))
    }

    /// The bound of every receiver (rows x 3) for `shown`, the picture that was written last; `number` is its step's.
    pub fn bounds(&self, number: u64, shown: &[f32], out: &mut [f32]) -> Result<()> {
        self.check_room(shown)?;
        self.check_room(out)?;
        if number != self.shown {
            return Err(Error::input("expected the frame that was made last: bounds of earlier ones are gone"));
        }
        let of: Vec<Vec<[f64; 3]>> = if self.chain.clustered.is_empty() {
            let outputs = self.outputs();
            outputs.iter().map(|output| Ok(bound_rows(output.matrix, measured(output)?))).collect::<Result<_>>()?
        } else {
            self.clustered().filter_map(|(clustered, of, unsent)| Some(clustered.rows(of?, unsent))).collect()
        };
        match (&self.chain.product.link, &self.mix) {
            (Link::Weights(weights), _) => finish_bounds(shown, out, |row, add| {
                add(of[0][row], 1.0);
                weights.row(row).for_each(|(node, weight)| add(of[1][node], weight.abs()));
            }),
            (_, Some(mix)) => finish_bounds(shown, out, |row, add| {
                of.iter().zip(mix.row(row)).for_each(|(of, weight)| add(of[row], f64::from(weight.abs())));
            }),
            (_, None) => finish_bounds(shown, out, |row, add| add(of[0][row], 1.0)),
        }
        Ok(())
    }

    /// V~, as applied so far to the first stage.
    pub fn values(&self) -> &[[f64; 3]] {
        self.first.values()
    }

    /// Bytes beyond M, in all stages.
    pub fn nbytes(&self) -> usize {
        let mix = self.mix.as_ref().map_or(0, |mix| 4 * mix.shape().0 * mix.shape().1);
        self.first.nbytes() + self.second.iter().map(Stage::nbytes).sum::<usize>() + mix
    }
}

fn measured<'a>(output: &Output<'a>) -> Result<&'a Measured> {
    output.measured.ok_or_else(|| Error::input("a bound needs a frame: call step first"))
}

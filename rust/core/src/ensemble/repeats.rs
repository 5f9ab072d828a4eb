//! All fits side by side, those of a repeated experiment from where its first one ended.

use nalgebra::{DMatrix, DVector};

use super::{Begin, End, Fit, Records, Status};
use crate::closed_loop::ClosedLoop;
use crate::error::{Error, Result};
use crate::residual::{Data, of_repeats};
use crate::stop::each;
use crate::whitened::LineNormal;

/// Fits from which on the others wait for the end of the first one, which leaves cores idle meanwhile.
const FEWEST: usize = 8;
/// Fits that share a run of the response: many beside its cost, few enough for every core to have some.
const TOGETHER: usize = 16;

/// Runs all fits, side by side over the cores.
///
/// A step into an unstable loop is rejected. What keeps a fit from its first evaluation is its own result. Fits that
/// follow each other, have the same start and bounds, and differ in what was measured alone, begin at the optimum of the
/// first of them; one that does not end at an optimum from there begins at its own start again.
///
/// # Errors
/// [`Error::Stopped`].
pub fn fit_all(fits: &[Fit<'_>]) -> Result<Vec<Result<End>>> {
    let sets: Vec<&[Fit<'_>]> = fits
        .chunk_by(Fit::is_repeated_by)
        .flat_map(|set| set.chunks(if set.len() < FEWEST { 1 } else { set.len() }))
        .collect();
    let firsts = each(&sets, |_, set| unless_stopped(set[0].run(None)))?;
    let shared = sets.iter().zip(&firsts).flat_map(|(set, first)| {
        let first = first.as_ref().ok().filter(|(_, end)| end.status == Status::Converged);
        set[1..].chunks(TOGETHER).map(move |some| (some, first))
    });
    let begun = each(&shared.collect::<Vec<_>>(), |_, (some, first)| match first {
        Some((x, end)) => known_at(some, x, &end.theta),
        None => Ok(some.iter().map(|_| None).collect()),
    })?;
    let followers: Vec<(&Fit<'_>, Option<Begin>)> =
        sets.iter().flat_map(|set| &set[1..]).zip(begun.into_iter().flatten()).collect();
    let mut ends = each(&followers, |_, (fit, begin)| fit.follow(begin.clone()))?.into_iter();
    let each_set = sets.iter().zip(firsts).map(|(set, first)| {
        std::iter::once(first.map(|(_, end)| end)).chain(ends.by_ref().take(set.len() - 1)).collect::<Vec<_>>()
    });
    Ok(each_set.flatten().collect())
}

/// What is known of each of some repeats at the optimum of the first one; nothing where they cannot begin there.
fn known_at(some: &[Fit<'_>], x: &DVector<f64>, theta: &[f64]) -> Result<Vec<Option<Begin>>> {
    let Some((system, _)) = some.first().and_then(Fit::alone_on_samples) else { return Ok(Vec::new()) };
    let records: Vec<&Data> = some.iter().filter_map(|fit| Some(fit.alone_on_samples()?.1)).collect();
    match of_repeats(system, theta, &some[0].free, &records) {
        Err(Error::Stopped) => Err(Error::Stopped),
        Err(_) => Ok(vec![None; some.len()]),
        Ok(found) => Ok(found.into_iter().map(|own| Some(Begin { x: x.clone(), normal: own.into() })).collect()),
    }
}

fn unless_stopped<T>(found: Result<T>) -> Result<Result<T>> {
    match found {
        Err(Error::Stopped) => Err(Error::Stopped),
        found => Ok(found),
    }
}

/// A step: its end, itself, and what it is promised to gain.
struct Newton {
    x: DVector<f64>,
    step: DVector<f64>,
    gain: f64,
}

/// The quadratic form at the end of a step, as it promises.
fn after(mut normal: LineNormal, step: &Newton, scales: &DVector<f64>) -> LineNormal {
    normal.gradient += &normal.hessian * step.step.component_mul(scales);
    normal.cost -= step.gain;
    normal
}

impl<'a> Fit<'a> {
    /// From where others ended, if that leads to an optimum; else from the start.
    fn follow(&self, begin: Option<Begin>) -> Result<Result<End>> {
        if let Some(begin) = begin
            && let Ok(end) = unless_stopped(self.nearby(begin))?
            && end.status == Status::Converged
        {
            return Ok(Ok(end));
        }
        unless_stopped(self.run(None).map(|(_, end)| end))
    }

    /// From where another one ended. Where two steps show how fast steps shrink, and what a third would still gain is
    /// less than a descent looks for, the end of the second is not evaluated; else the descent goes on from the first.
    fn nearby(&self, begin: Begin) -> Result<End> {
        let Some(first) = self.newton(&begin) else { return self.run(Some(begin)).map(|(_, end)| end) };
        let normal = self.normal(&self.theta_at(&first.x), &[])?;
        let (fall, at) = (begin.normal.cost - normal.cost, Begin { x: first.x, normal });
        match self.newton(&at) {
            Some(second)
                if fall > 0.25 * first.gain
                    && second.gain.powi(2) < self.step.powf(1.5) * at.normal.cost * first.gain =>
            {
                let (theta, normal) = (self.theta_at(&second.x), after(at.normal, &second, &self.scales()));
                Ok(End { theta, status: Status::Converged, evaluations: 2, normal })
            }
            _ => self.run(Some(at)).map(|(_, end)| end),
        }
    }

    /// The whole step of Gauss and Newton; none where it leads to a bound, or is not determined.
    fn newton(&self, at: &Begin) -> Option<Newton> {
        let scales = self.scales();
        let unit = DMatrix::from_diagonal(&scales);
        let gradient = at.normal.gradient.component_mul(&scales);
        let step = -(&unit * &at.normal.hessian * &unit).cholesky()?.solve(&gradient);
        let (gain, x) = (-gradient.dot(&step), &at.x + &step);
        let is_inside = x.iter().zip(self.lower.iter().zip(&self.upper)).all(|(x, (low, high))| low < x && x < high);
        (is_inside && gain > 0.0).then_some(Newton { x, step, gain })
    }

    /// The loop and the record of a fit of one record in time.
    fn alone_on_samples(&self) -> Option<(&'a ClosedLoop, &'a Data)> {
        match &self.groups[..] {
            [(system, Records::Samples(records))] if records.len() == 1 => Some((system, records[0])),
            _ => None,
        }
    }

    /// Whether another fit is the same but for what was measured.
    fn is_repeated_by(&self, other: &Self) -> bool {
        let (Some((system, data)), Some((its, of_it))) = (self.alone_on_samples(), other.alone_on_samples()) else {
            return false;
        };
        std::ptr::eq(system, its)
            && (self.most, self.step) == (other.most, other.step)
            && self.free == other.free
            && [&self.theta, &self.scale, &self.lower, &self.upper, &self.x]
                == [&other.theta, &other.scale, &other.lower, &other.upper, &other.x]
            && data.is_repeated_by(of_it)
    }
}

//! Many fits at once: they find the truth, stay within their bounds, and end as they end alone.

mod common;

use ambid_core::{ClosedLoop, Data, End, Error, Fit, LineData, Records, Result, Status, fit_all};
use common::loops::{Problem, lags};
use common::machine::machine;
use common::random::Random;
use common::spectrum::{C64, points};

/// Without noise a fit ends this near the truth.
const NEAR: f64 = 1e-7;

fn samples(p: &Problem, random: &mut Random, noise: f64) -> Data {
    let system = p.system();
    let u = random.signal(400 * system.inputs());
    let mut z = system.simulate(&p.theta, &u).expect("stable");
    let size = z.iter().fold(0.0_f64, |a, z| a.max(z.abs()));
    z.iter_mut().for_each(|z| *z += noise * size * random.between(-1.0, 1.0));
    Data::new(&system, u, z, vec![1.0 / size; system.outputs()], 0).expect("consistent")
}

fn lines(p: &Problem, random: &mut Random) -> LineData {
    let (system, count) = (p.system(), 60);
    let w = points(2 * count - 2);
    let mut number = || C64::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0));
    let u: Vec<C64> = (0..count * system.inputs()).map(|_| number()).collect();
    let z = system.lines(&p.theta, &[], &w, &u, &[], false).expect("stable").response;
    let (p, size) = (system.outputs(), z.iter().fold(0.0_f64, |a, z| a.max(z.norm())));
    let own = |i: usize| if i / p % p == i % p { C64::from(1.0 / size) } else { C64::from(0.0) };
    let whitening = (0..count * p * p).map(own).collect();
    LineData::new(&system, w, u, z, whitening).expect("consistent")
}

fn fit<'a>(p: &Problem, system: &'a ClosedLoop, records: Records<'a>, off: f64) -> Fit<'a> {
    let free: Vec<usize> = p.free();
    Fit {
        groups: vec![(system, records)],
        theta: p.theta.clone(),
        scale: p.theta.clone(),
        lower: vec![0.0; free.len()],
        upper: vec![f64::INFINITY; free.len()],
        x: vec![off; free.len()],
        free,
        most: 100,
        enough: 0.0,
        numbers: 0.0,
        witnesses: 0.0,
        prior: vec![0.0; p.free().len()],
        step: 1e-8,
    }
}

fn assert_truth(end: &Result<End>, p: &Problem) {
    let end = end.as_ref().expect("stable");
    assert_eq!(end.status, Status::Converged);
    for (found, truth) in end.theta.iter().zip(&p.theta) {
        assert!((found / truth - 1.0).abs() < NEAR, "{found} for {truth}");
    }
}

#[test]
fn samples_and_lines_lead_to_the_truth() {
    let mut random = Random(1);
    for p in [lags(&[0.7, 1.9], &[&[], &[0]], &[0, 1]), machine(0.0, 0.02)] {
        let (system, time, spectrum) = (p.system(), samples(&p, &mut random, 0.0), lines(&p, &mut random));
        let fits = [
            fit(&p, &system, Records::Samples(vec![&time]), 1.05),
            fit(&p, &system, Records::Lines(vec![&spectrum]), 1.05),
        ];
        fit_all(&fits).expect("nobody stops it").iter().for_each(|end| assert_truth(end, &p));
    }
}

#[test]
fn groups_of_two_kinds_add_up() {
    let p = lags(&[0.7, 1.9], &[&[], &[0]], &[1]);
    let mut random = Random(2);
    let (system, time, spectrum) = (p.system(), samples(&p, &mut random, 0.1), lines(&p, &mut random));
    let each = [Records::Samples(vec![&time]), Records::Lines(vec![&spectrum, &spectrum])];
    let mut both = fit(&p, &system, each[0].clone(), 1.0);
    both.groups.push((&system, each[1].clone()));
    both.most = 1;
    let alone = each.map(|records| Fit { most: 1, ..fit(&p, &system, records, 1.0) });
    let ends: Vec<End> = fit_all(&[alone[0].clone(), alone[1].clone(), both])
        .expect("nobody stops it")
        .into_iter()
        .map(|end| end.expect("stable"))
        .collect();
    let sum = ends[0].normal.cost + ends[1].normal.cost;
    assert!((ends[2].normal.cost / sum - 1.0).abs() < 1e-12);
    assert_eq!(ends[2].normal.transients.len(), 2);
    assert_eq!(ends[2].status, Status::MaxEvaluations);
}

#[test]
fn bounds_hold() {
    let p = lags(&[0.7, 1.9], &[&[], &[0]], &[0, 1]);
    let (system, data) = (p.system(), samples(&p, &mut Random(3), 0.01));
    let mut bounded = fit(&p, &system, Records::Samples(vec![&data]), 0.8);
    bounded.upper[0] = 0.9;
    let end = fit_all(&[bounded]).expect("nobody stops it").remove(0).expect("stable");
    assert_eq!(end.status, Status::AtBound);
    assert!(end.theta[0] <= 0.9 * p.theta[0] && end.theta[0] > 0.899 * p.theta[0]);
}

#[test]
fn fits_end_beside_others_as_alone() {
    let p = machine(0.0, 0.02);
    let (system, mut random) = (p.system(), Random(4));
    let data: Vec<Data> = (0..6).map(|_| samples(&p, &mut random, 0.2)).collect();
    let fits: Vec<Fit<'_>> = data.iter().map(|own| fit(&p, &system, Records::Samples(vec![own]), 1.1)).collect();
    let together = fit_all(&fits).expect("nobody stops it");
    for (own, beside) in fits.iter().zip(together) {
        let alone = fit_all(std::slice::from_ref(own)).expect("nobody stops it").remove(0).expect("stable");
        let beside = beside.expect("stable");
        assert_eq!((alone.theta, alone.evaluations), (beside.theta, beside.evaluations));
    }
}

#[test]
fn one_that_cannot_begin_leaves_the_others_alone() {
    let p = machine(0.0, 0.02);
    let (system, data) = (p.system(), samples(&p, &mut Random(5), 0.0));
    let good = fit(&p, &system, Records::Samples(vec![&data]), 1.05);
    let unstable = Fit { x: vec![1e-3; good.x.len()], ..good.clone() };
    let short = Fit { scale: Vec::new(), ..good.clone() };
    let ends = fit_all(&[unstable, good, short]).expect("nobody stops it");
    assert!(matches!(ends[0], Err(Error::Unstable { .. })));
    assert_truth(&ends[1], &p);
    assert!(matches!(ends[2], Err(Error::Shape { what: "scale", .. })));
}

/// Difference of a repeat from the same fit alone, in standard errors; both stop within less of their optimum.
const ALIKE: f64 = 1e-3;

/// Records of one excitation, and their noise of this size relative to the largest output.
fn repeats(p: &Problem, random: &mut Random, noise: f64) -> Vec<Data> {
    let system = p.system();
    let u = random.signal(400 * system.inputs());
    let z = system.simulate(&p.theta, &u).expect("stable");
    let size = z.iter().fold(0.0_f64, |a, z| a.max(z.abs()));
    let mut weights = vec![1.0 / (noise * size); system.outputs()];
    weights[0] = 0.0;
    let mut one = || z.iter().map(|z| z + noise * size * random.between(-1.0, 1.0)).collect();
    let of = |z| Data::new(&system, u.clone(), z, weights.clone(), 20).expect("consistent");
    (0..20).map(|_| of(one())).collect()
}

#[test]
fn repeats_end_at_their_own_optimum_in_fewer_evaluations() {
    let p = machine(0.0, 0.02);
    let (system, mut random) = (p.system(), Random(6));
    let data = repeats(&p, &mut random, 0.05);
    let fits: Vec<Fit<'_>> = data.iter().map(|own| fit(&p, &system, Records::Samples(vec![own]), 1.1)).collect();
    let (mut as_repeats, mut by_themselves) = (0, 0);
    for (own, beside) in fits.iter().zip(fit_all(&fits).expect("nobody stops it")) {
        let alone = fit_all(std::slice::from_ref(own)).expect("nobody stops it").remove(0).expect("stable");
        let beside = beside.expect("stable");
        assert_eq!(beside.status, Status::Converged);
        as_repeats += beside.evaluations;
        by_themselves += alone.evaluations;
        assert!((beside.normal.cost / alone.normal.cost - 1.0).abs() < 1e-9);
        let curvature = alone.normal.hessian.diagonal();
        for ((found, expected), curvature) in beside.theta.iter().zip(&alone.theta).zip(&curvature) {
            assert!((found - expected).abs() * curvature.sqrt() < ALIKE, "{found} for {expected}");
        }
    }
    assert!(as_repeats < by_themselves, "{as_repeats} for {by_themselves}");
}

#[test]
fn a_repeat_that_finds_no_optimum_from_there_begins_at_its_own_start() {
    let p = machine(0.0, 0.02);
    let (system, mut random) = (p.system(), Random(7));
    let data = repeats(&p, &mut random, 0.05);
    let some = data.iter().map(|own| Fit { most: 2, ..fit(&p, &system, Records::Samples(vec![own]), 1.1) });
    let fits: Vec<Fit<'_>> = some.collect();
    for (own, beside) in fits.iter().zip(fit_all(&fits).expect("nobody stops it")) {
        let alone = fit_all(std::slice::from_ref(own)).expect("nobody stops it").remove(0).expect("stable");
        assert_eq!(beside.expect("stable").theta, alone.theta);
    }
}

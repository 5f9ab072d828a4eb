//! A closed loop as data: the plant as an LFT, and, where the controller is digital, the controller.

use nalgebra::DMatrix;

use crate::error::{Error, Result, check_finite, check_len};
use crate::lft::Lft;
use crate::reading::Late;

/// Commands that may be under way.
const MOST_UNDER_WAY: f64 = 1000.0;

/// A digital controller K: `i_ref = -K y + excitation i_e`, computed once a controller sample, held, and delayed.
///
/// It reads `reads` times the outputs of the plant, plus `takes` times its inputs (such as a reference, negative), as
/// they are at its own samples, and drives the first `c.nrows()` inputs. The excitation is added before the delay.
/// Further inputs of the plant are held over a sample of the record.
///
/// Without states and with D = 0 it delays the excitation alone, of a loop that is closed already.
#[derive(Debug, Clone)]
pub struct Controller {
    /// States x states, over one controller sample.
    pub a: DMatrix<f64>,
    /// States x signals that it reads.
    pub b: DMatrix<f64>,
    /// Channels x states.
    pub c: DMatrix<f64>,
    /// Channels x signals that it reads.
    pub d: DMatrix<f64>,
    /// Signals that it reads x the first outputs of the plant; those beyond its columns it does not read.
    pub reads: DMatrix<f64>,
    /// So many outputs of the plant, the last, are no outputs of the loop: it alone reads them.
    pub hidden: usize,
    /// Signals that it reads x the first inputs of the plant, likewise; commands have a zero here.
    pub takes: DMatrix<f64>,
    /// Delay of everything that leaves the controller, in controller samples; need not be whole.
    pub delay: f64,
    /// Index of the parameter that is a further delay, in seconds. What arrives just at a sample is seen by the next.
    pub late: Option<usize>,
    /// Controller samples per sample of the record.
    pub steps: usize,
    /// Channels x channels: what acts of the excitations that are recorded; the unit matrix where it is these.
    pub excitation: DMatrix<f64>,
    /// By what its gains depend on parameters.
    pub errors: Vec<GainError>,
}

/// What a parameter adds to the commands of a digital controller: `theta (-C x - D read + excitation i_e)`.
#[derive(Debug, Clone)]
pub struct GainError {
    /// Index into the parameter vector.
    pub parameter: usize,
    /// Channels x states.
    pub c: DMatrix<f64>,
    /// Channels x signals that are read.
    pub d: DMatrix<f64>,
    /// Channels x channels, of the excitations that are recorded.
    pub excitation: DMatrix<f64>,
}

/// A closed loop: an analog one is an LFT alone; a digital one an LFT between commands and outputs, and a controller.
#[derive(Debug, Clone)]
pub struct Model {
    /// The plant, or the whole of an analog loop.
    pub lft: Lft,
    /// Sample time of the record in seconds.
    pub dt: f64,
    /// None where the controller is analog and part of `lft`.
    pub controller: Option<Controller>,
    /// Substeps for nonlinear blocks while a command is held (a sample, where the controller is analog, or the part of
    /// a controller sample before or after the delay); chosen by the response itself where there is none.
    pub substeps: Option<usize>,
    /// Outputs that are recorded late or early. What a controller reads is not.
    pub late: Vec<Late>,
}

impl Controller {
    /// At the rate of the record, without delay, its gains known; it reads the first outputs of the plant.
    pub fn new(a: DMatrix<f64>, b: DMatrix<f64>, c: DMatrix<f64>, d: DMatrix<f64>) -> Self {
        let (reads, takes) = (DMatrix::identity(d.ncols(), d.ncols()), DMatrix::zeros(d.ncols(), 0));
        let excitation = DMatrix::identity(d.nrows(), d.nrows());
        let (hidden, delay, late, steps, errors) = (0, 0.0, None, 1, Vec::new());
        Self { a, b, c, d, reads, hidden, takes, delay, late, steps, excitation, errors }
    }

    /// Number of commands given.
    pub fn channels(&self) -> usize {
        self.d.nrows()
    }

    /// Number of signals read.
    pub fn signals(&self) -> usize {
        self.d.ncols()
    }

    /// Whether a signal that is read follows a command at once, by what `d` brings from the inputs to the outputs.
    pub(crate) fn reads_commands(&self, d: &DMatrix<f64>) -> bool {
        (&self.reads * d.columns(0, self.channels())).iter().any(|x| *x != 0.0)
    }

    /// Whether it closes a loop, or delays the excitation alone.
    pub(crate) fn feeds_back(&self) -> bool {
        let errors = self.errors.iter().flat_map(|e| e.c.iter().chain(&e.d));
        self.c.iter().chain(&self.d).chain(errors).any(|x| *x != 0.0)
    }

    /// The same with its gains and the whole of its delay at `theta`; `dt` is the sample time of the record in seconds.
    ///
    /// # Errors
    /// [`Error::Singular`] where commands would arrive before they are given, or more than [`MOST_UNDER_WAY`] are.
    pub(crate) fn at(&self, theta: &[f64], dt: f64) -> Result<Self> {
        let delay = self.delay + self.late.map_or(0.0, |late| theta[late] * self.steps as f64 / dt);
        if (0.0..MOST_UNDER_WAY).contains(&delay) {
            let mut at = Self { delay, ..self.clone() };
            for error in &self.errors {
                let theta = theta[error.parameter];
                at.c += &error.c * theta;
                at.d += &error.d * theta;
                at.excitation += &error.excitation * theta;
            }
            return Ok(at);
        }
        Err(Error::Singular { what: "the delay of the commands is negative, or 1000 controller samples and more" })
    }

    /// Derivative of its C, D and gain of the excitation by a parameter; none where they do not depend on it.
    pub(crate) fn slope(&self, parameter: usize) -> Option<GainError> {
        let own = self.errors.iter().filter(|error| error.parameter == parameter).cloned();
        own.reduce(|sum, error| GainError {
            c: sum.c + error.c,
            d: sum.d + error.d,
            excitation: sum.excitation + error.excitation,
            parameter,
        })
    }

    /// Whole controller samples of the delay, the rest of it in samples, and whether that rest counts though it be 0.
    pub(crate) fn split_delay(&self) -> (usize, f64, bool) {
        let (whole, fraction) = (self.delay.floor(), self.delay.fract());
        (whole as usize, fraction, fraction > 0.0 || self.late.is_some())
    }
}

impl Model {
    /// Checks that the controller fits the plant, which may have further inputs and outputs.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::NotFinite`].
    pub fn new(lft: Lft, dt: f64, mut controller: Option<Controller>) -> Result<Self> {
        check_finite("logarithm of dt", &[dt.ln(), 1.0 / dt])?;
        if let Some(k) = &mut controller {
            let (n, m, q) = (k.a.nrows(), k.channels(), k.signals());
            check_len("controller A (columns)", k.a.ncols(), n)?;
            check_len("controller B (rows)", k.b.nrows(), n)?;
            check_len("controller B (columns)", k.b.ncols(), q)?;
            check_len("controller C (rows)", k.c.nrows(), m)?;
            check_len("controller C (columns)", k.c.ncols(), n)?;
            check_len("what the controller reads (rows)", k.reads.nrows(), q)?;
            check_len("what the controller takes (rows)", k.takes.nrows(), q)?;
            check_len("excitation (rows)", k.excitation.nrows(), m)?;
            check_len("excitation (columns)", k.excitation.ncols(), m)?;
            for part in [&k.a, &k.b, &k.c, &k.d, &k.reads, &k.takes, &k.excitation] {
                check_finite("controller", part.as_slice())?;
            }
            for GainError { c, d, excitation, .. } in &k.errors {
                for (what, found, expected) in [
                    ("gain error C (rows)", c.nrows(), m),
                    ("gain error C (columns)", c.ncols(), n),
                    ("gain error D (rows)", d.nrows(), m),
                    ("gain error D (columns)", d.ncols(), q),
                    ("gain error of the excitation (rows)", excitation.nrows(), m),
                    ("gain error of the excitation (columns)", excitation.ncols(), m),
                ] {
                    check_len(what, found, expected)?;
                }
                for part in [c, d, excitation] {
                    check_finite("gain error", part.as_slice())?;
                }
            }
            let (inputs, outputs) = (m.max(k.takes.ncols()), m.max(k.reads.ncols()).max(k.hidden));
            for (what, found, needed) in
                [("plant inputs", lft.inputs(), inputs), ("plant outputs", lft.outputs(), outputs)]
            {
                if found < needed {
                    let (found, expected) = (found.to_string(), format!("at least the {needed} of the controller"));
                    return Err(Error::Shape { what, found, expected });
                }
            }
            k.reads.resize_horizontally_mut(lft.outputs(), 0.0);
            k.takes.resize_horizontally_mut(lft.inputs(), 0.0);
            if !(k.delay >= 0.0 && k.delay.is_finite()) || k.steps == 0 {
                return Err(Error::NotFinite { what: "controller delay or steps" });
            }
            if k.takes.columns(0, m).iter().any(|x| *x != 0.0) {
                return Err(Error::Singular { what: "the controller takes its own command at once" });
            }
            if k.reads_commands(&lft.d.rows(0, lft.outputs()).into_owned()) {
                let what = "a signal that the controller reads follows a command at once (D is not zero)";
                return Err(Error::Singular { what });
            }
        }
        Ok(Self { lft, dt, controller, substeps: None, late: Vec::new() })
    }

    /// The same with outputs that are recorded late or early.
    ///
    /// # Errors
    /// [`Error::Shape`] where there is no such output, [`Error::NotFinite`].
    pub fn recorded(mut self, late: Vec<Late>) -> Result<Self> {
        for Late { output, scale, .. } in &late {
            check_finite("scale of a delay", &[*scale])?;
            if *output >= self.outputs() {
                let (found, expected) = (output.to_string(), format!("less than {}", self.outputs()));
                return Err(Error::Shape { what: "output that is late", found, expected });
            }
        }
        self.late = late;
        Ok(self)
    }

    /// Number of inputs of the closed loop: excitations, then further inputs of the plant.
    pub fn inputs(&self) -> usize {
        self.lft.inputs()
    }

    /// The parameter of every gain, coefficient, delay and gain error that has one.
    pub fn parameters(&self) -> impl Iterator<Item = usize> {
        let of_controller = |k: &Controller| {
            let errors: Vec<usize> = k.errors.iter().map(|error| error.parameter).collect();
            k.late.into_iter().chain(errors)
        };
        let of_outputs = self.late.iter().map(|late| late.parameter);
        self.lft.parameters().chain(self.controller.iter().flat_map(of_controller)).chain(of_outputs)
    }

    /// Number of inputs of the plant that a digital controller drives.
    pub(crate) fn commands(&self) -> usize {
        self.controller.as_ref().map_or(0, Controller::channels)
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.lft.outputs() - self.controller.as_ref().map_or(0, |k| k.hidden)
    }
}

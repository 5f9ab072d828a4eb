//! A closed loop as data: the plant as an LFT, and, where the controller is digital, the controller.

use nalgebra::DMatrix;

use crate::error::{Error, Result, check_finite, check_len};
use crate::lft::Lft;

/// Commands that may be under way.
const MOST_UNDER_WAY: f64 = 1000.0;

/// A digital controller K: `i_ref = -K y + i_e`, computed once a controller sample, held, and delayed.
///
/// It reads the first `b.ncols()` outputs of the plant and drives the first `c.nrows()` inputs; both counts are
/// equal. The excitation is added before the delay. Further inputs of the plant are held over a sample of the record.
///
/// Without states and with D = 0 it delays the excitation alone, of a loop that is closed already.
#[derive(Debug, Clone)]
pub struct Controller {
    /// States x states, over one controller sample.
    pub a: DMatrix<f64>,
    /// States x channels.
    pub b: DMatrix<f64>,
    /// Channels x states.
    pub c: DMatrix<f64>,
    /// Channels x channels.
    pub d: DMatrix<f64>,
    /// Delay of everything that leaves the controller, in controller samples; need not be whole.
    pub delay: f64,
    /// Index of the parameter that is a further delay, in seconds. What arrives just at a sample is seen by the next.
    pub late: Option<usize>,
    /// Controller samples per sample of the record.
    pub steps: usize,
    /// True where as many inputs, the last of the loop, are added to the displacements that are read (sensor noise).
    pub noise: bool,
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
}

impl Controller {
    /// Number of displacements read and of commands given.
    pub fn channels(&self) -> usize {
        self.d.nrows()
    }

    /// Whether it closes a loop, or delays the excitation alone.
    pub(crate) fn feeds_back(&self) -> bool {
        self.c.iter().chain(&self.d).any(|x| *x != 0.0)
    }

    /// The same with the whole of its delay at `theta`; `dt` is the sample time of the record in seconds.
    ///
    /// # Errors
    /// [`Error::Singular`] where commands would arrive before they are given, or more than [`MOST_UNDER_WAY`] are.
    pub(crate) fn at(&self, theta: &[f64], dt: f64) -> Result<Self> {
        let delay = self.delay + self.late.map_or(0.0, |late| theta[late] * self.steps as f64 / dt);
        if (0.0..MOST_UNDER_WAY).contains(&delay) {
            return Ok(Self { delay, ..self.clone() });
        }
        Err(Error::Singular { what: "the delay of the commands is negative, or 1000 controller samples and more" })
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
    pub fn new(lft: Lft, dt: f64, controller: Option<Controller>) -> Result<Self> {
        check_finite("logarithm of dt", &[dt.ln(), 1.0 / dt])?;
        if let Some(k) = &controller {
            let (n, m) = (k.a.nrows(), k.channels());
            check_len("controller A (columns)", k.a.ncols(), n)?;
            check_len("controller B (rows)", k.b.nrows(), n)?;
            check_len("controller B (columns)", k.b.ncols(), m)?;
            check_len("controller C (rows)", k.c.nrows(), m)?;
            check_len("controller C (columns)", k.c.ncols(), n)?;
            check_len("controller D (columns)", k.d.ncols(), m)?;
            for part in [&k.a, &k.b, &k.c, &k.d] {
                check_finite("controller", part.as_slice())?;
            }
            for (what, found) in [("plant inputs", lft.inputs()), ("plant outputs", lft.outputs())] {
                if found < m {
                    let (found, expected) = (found.to_string(), format!("at least the {m} channels of the controller"));
                    return Err(Error::Shape { what, found, expected });
                }
            }
            if !(k.delay >= 0.0 && k.delay.is_finite()) || k.steps == 0 {
                return Err(Error::NotFinite { what: "controller delay or steps" });
            }
            if (0..m).any(|i| (0..m).any(|j| lft.d[(i, j)] != 0.0)) {
                return Err(Error::Singular { what: "a displacement follows a command at once (D is not zero)" });
            }
        }
        Ok(Self { lft, dt, controller, substeps: None })
    }

    /// Number of inputs of the closed loop: excitations, further inputs of the plant, then noise where there is any.
    pub fn inputs(&self) -> usize {
        let noise = self.controller.as_ref().filter(|k| k.noise).map_or(0, Controller::channels);
        self.lft.inputs() + noise
    }

    /// The parameter of every gain, coefficient and delay that has one.
    pub fn parameters(&self) -> impl Iterator<Item = usize> {
        self.lft.parameters().chain(self.controller.iter().filter_map(|k| k.late))
    }

    /// Number of inputs of the plant that a digital controller drives.
    pub(crate) fn commands(&self) -> usize {
        self.controller.as_ref().map_or(0, Controller::channels)
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.lft.outputs()
    }
}

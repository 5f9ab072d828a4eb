//! A loop at one parameter set as a file, for programs without Python: written by one of its own, read by any.
//!
//! ```text
//! "ambid stepper 4\n"
//! names of inputs, of outputs, of parameters       lists of text
//! theta                                            list of numbers
//! dt, substeps                                     number, optional count
//! A, B, C, D                                       matrices
//! gains                                            list of: parameter (count), scale (number), power (i32)
//! blocks                                           list of: law, coefficients (list)
//! controller                                       optional: A, B, C, D, reads, hidden (count), takes,
//!                                                  delay (number), late (optional count), steps (count),
//!                                                  excitation, gain errors (list of: parameter, C, D,
//!                                                  excitation)
//! late outputs                                     list of: output, parameter (counts), scale (number)
//! checksum                                         u64, FNV-1a of all bytes before
//! ```
//!
//! All is little-endian. A count is a u32; a number an f64; a flag, and what begins an optional, one byte, 0 or 1; a
//! list its count, then its members; a text a list of bytes in UTF-8; a matrix its rows and columns (counts), then its
//! numbers column by column. Laws and coefficients begin with one byte that says which: see `laws.rs`.

mod laws;
mod part;

use crate::closed_loop::ClosedLoop;
use crate::error::{Error, Result, check_finite, check_len};
use crate::lft::{Gain, Lft};
use crate::model::{Controller, GainError, Model};
use crate::reading::Late;
use part::{Part, Source};

/// How a file begins; the number grows with every change of what follows.
const MAGIC: &[u8] = b"ambid stepper 4\n";
/// Size of the checksum.
const CHECK: usize = 8;
/// States of a loop, commands under way among them: its exponential then takes seconds, and some 100 MB.
const MOST_STATES: f64 = 1024.0;
/// Controller samples per sample, and substeps: more are no loop that runs in real time.
const MOST_STEPS: usize = 4096;

/// A model at one parameter set, with names.
#[derive(Debug, Clone)]
pub struct Packed {
    /// The loop; its inputs, outputs and parameters have as many names.
    pub model: Model,
    /// Value of each parameter, SI units.
    pub theta: Vec<f64>,
    /// Such as `i_e.A_zeta`.
    pub inputs: Vec<String>,
    /// Such as `y.A_zeta`.
    pub outputs: Vec<String>,
    /// Such as `K_i.A_zeta`.
    pub parameters: Vec<String>,
}

impl Packed {
    /// The file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = MAGIC.to_vec();
        let Self { model, theta, inputs, outputs, parameters } = self;
        [inputs, outputs, parameters].into_iter().for_each(|names| names.put(&mut out));
        theta.put(&mut out);
        model.put(&mut out);
        let check = checksum(&out);
        out.extend(check.to_le_bytes());
        out
    }

    /// Reads what [`Packed::to_bytes`] wrote. Whatever the bytes, it ends, in memory of the order of their number.
    ///
    /// # Errors
    /// [`Error::Format`] where they are no such file or have been damaged; where they describe no loop as
    /// [`Model::new`], or one too large for a step.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        let broken = |what| Error::Format { what, at: 0 };
        let body = bytes.strip_prefix(MAGIC);
        let body = body.ok_or(broken("it does not begin as a stepper file of version 4 does"))?;
        let (body, check) = body.split_last_chunk::<CHECK>().ok_or(broken("it is cut short"))?;
        if checksum(&bytes[..bytes.len() - CHECK]) != u64::from_le_bytes(*check) {
            return Err(broken("its checksum is wrong: it has been cut or changed"));
        }
        let mut source = Source::new(body, MAGIC.len());
        let (inputs, outputs, parameters) = (source.take()?, source.take()?, source.take()?);
        let found = Self { inputs, outputs, parameters, theta: source.take()?, model: source.take()? };
        source.end()?;
        check_len("names of inputs", found.inputs.len(), found.model.inputs())?;
        check_len("names of outputs", found.outputs.len(), found.model.outputs())?;
        check_len("names of parameters", found.parameters.len(), found.theta.len())?;
        check_finite("parameter vector", &found.theta)?;
        found.require_small()?;
        Ok(found)
    }

    /// The loop.
    ///
    /// # Errors
    /// As [`ClosedLoop::new`].
    pub fn system(&self) -> Result<ClosedLoop> {
        ClosedLoop::new(self.model.clone(), self.theta.len())
    }

    /// Refuses a loop that no stepper could hold.
    fn require_small(&self) -> Result<()> {
        let Model { lft, dt, controller, substeps, .. } = &self.model;
        let system = self.system()?;
        system.check(&self.theta, &[])?;
        let (mut states, mut steps) = (lft.a.nrows() as f64, substeps.unwrap_or(1));
        if let Some(k) = controller {
            let delay = k.at(&self.theta, *dt)?.delay;
            states += k.a.nrows() as f64 + k.channels() as f64 * delay.ceil();
            steps = steps.max(k.steps);
        }
        if states > MOST_STATES || steps > MOST_STEPS {
            return Err(Error::Format { what: "the loop has more states or steps than any that runs", at: 0 });
        }
        Ok(())
    }
}

/// FNV-1a: against damage, not against malice, which all that is read is checked for.
fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

impl Part for Model {
    fn put(&self, out: &mut Vec<u8>) {
        let Self { lft, dt, controller, substeps, late } = self;
        dt.put(out);
        substeps.put(out);
        [&lft.a, &lft.b, &lft.c, &lft.d].into_iter().for_each(|m| m.put(out));
        lft.gains.put(out);
        lft.blocks.put(out);
        controller.put(out);
        late.put(out);
    }

    fn take(source: &mut Source) -> Result<Self> {
        let (dt, substeps) = (source.take()?, source.take()?);
        let [a, b, c, d] = [source.take()?, source.take()?, source.take()?, source.take()?];
        let lft = Lft::with_blocks(a, b, c, d, source.take()?, source.take()?)?;
        let model = Self::new(lft, dt, source.take()?)?.recorded(source.take()?)?;
        Ok(Self { substeps, ..model })
    }
}

impl Part for Gain {
    fn put(&self, out: &mut Vec<u8>) {
        self.parameter.put(out);
        self.scale.put(out);
        self.power.put(out);
    }

    fn take(source: &mut Source) -> Result<Self> {
        Ok(Self { parameter: source.take()?, scale: source.take()?, power: source.take()? })
    }
}

impl Part for Late {
    fn put(&self, out: &mut Vec<u8>) {
        self.output.put(out);
        self.parameter.put(out);
        self.scale.put(out);
    }

    fn take(source: &mut Source) -> Result<Self> {
        Ok(Self { output: source.take()?, parameter: source.take()?, scale: source.take()? })
    }
}

impl Part for Controller {
    fn put(&self, out: &mut Vec<u8>) {
        let Self { a, b, c, d, reads, hidden, takes, delay, late, steps, excitation, errors } = self;
        [a, b, c, d, reads].into_iter().for_each(|m| m.put(out));
        hidden.put(out);
        takes.put(out);
        delay.put(out);
        late.put(out);
        steps.put(out);
        excitation.put(out);
        errors.put(out);
    }

    fn take(source: &mut Source) -> Result<Self> {
        Ok(Self {
            a: source.take()?,
            b: source.take()?,
            c: source.take()?,
            d: source.take()?,
            reads: source.take()?,
            hidden: source.take()?,
            takes: source.take()?,
            delay: source.take()?,
            late: source.take()?,
            steps: source.take()?,
            excitation: source.take()?,
            errors: source.take()?,
        })
    }
}

impl Part for GainError {
    fn put(&self, out: &mut Vec<u8>) {
        self.parameter.put(out);
        self.c.put(out);
        self.d.put(out);
        self.excitation.put(out);
    }

    fn take(source: &mut Source) -> Result<Self> {
        Ok(Self { parameter: source.take()?, c: source.take()?, d: source.take()?, excitation: source.take()? })
    }
}

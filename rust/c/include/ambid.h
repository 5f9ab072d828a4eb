/* The stepper of an identified loop, sample by sample. Made from rust/c/src/stepper.rs by cbindgen. */

#ifndef AMBID_H
#define AMBID_H

#include <stddef.h>
#include <stdint.h>

// What a call did.
typedef enum AmbidStatus {
  // Done.
  AMBID_STATUS_OK = 0,
  // A pointer is NULL.
  AMBID_STATUS_NULL = 1,
  // The file cannot be read.
  AMBID_STATUS_FILE = 2,
  // The bytes are no stepper file, or a broken one.
  AMBID_STATUS_FORMAT = 3,
  // A number of inputs or outputs is not that of the loop.
  AMBID_STATUS_SIZE = 4,
  // An input is NaN or infinite.
  AMBID_STATUS_NOT_FINITE = 5,
  // A mistake in the library.
  AMBID_STATUS_INTERNAL = 6,
} AmbidStatus;

// A loop under way. One thread at a time may use it.
typedef struct AmbidStepper AmbidStepper;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Reads a file that `ambid export MODEL --stepper FILE` wrote; the loop is at rest.
//
// `*stepper` becomes the loop, to be given back by `ambid_free`, or NULL.
//
// # Safety
// `path` is NULL or ends with a zero byte; `stepper` is NULL or points to a pointer.
enum AmbidStatus ambid_load(const char *path, struct AmbidStepper **stepper);

// The same from the bytes of such a file, which are not needed afterwards.
//
// # Safety
// `bytes` is NULL or points to `length` bytes; `stepper` is NULL or points to a pointer.
enum AmbidStatus ambid_load_bytes(const uint8_t *bytes,
                                  size_t length,
                                  struct AmbidStepper **stepper);

// One sample: `y` becomes the outputs of this instant, `u` is held until the next. SI units.
//
// Where it fails, the loop and `y` are as before.
//
// # Safety
// `stepper` is NULL or comes from `ambid_load`; `u` points to `inputs`, `y` to `outputs` numbers, which do not overlap.
enum AmbidStatus ambid_step(struct AmbidStepper *stepper,
                            const double *u,
                            size_t inputs,
                            double *y,
                            size_t outputs);

// Back to rest.
//
// # Safety
// `stepper` is NULL or comes from `ambid_load`.
enum AmbidStatus ambid_reset(struct AmbidStepper *stepper);

// Gives the memory back. NULL is allowed.
//
// # Safety
// `stepper` is NULL or comes from `ambid_load`, and is not used any more.
void ambid_free(struct AmbidStepper *stepper);

// Number of inputs; 0 of NULL.
//
// # Safety
// `stepper` is NULL or comes from `ambid_load`.
size_t ambid_inputs(const struct AmbidStepper *stepper);

// Number of outputs; 0 of NULL.
//
// # Safety
// `stepper` is NULL or comes from `ambid_load`.
size_t ambid_outputs(const struct AmbidStepper *stepper);

// Name of an input, such as `i_e.A_zeta`; it lives as long as the stepper. NULL where there is none.
//
// # Safety
// `stepper` is NULL or comes from `ambid_load`.
const char *ambid_input_name(const struct AmbidStepper *stepper,
                             size_t index);

// Name of an output, such as `y.A_zeta`; it lives as long as the stepper. NULL where there is none.
//
// # Safety
// `stepper` is NULL or comes from `ambid_load`.
const char *ambid_output_name(const struct AmbidStepper *stepper, size_t index);

// Time from sample to sample in seconds; 0 of NULL.
//
// # Safety
// `stepper` is NULL or comes from `ambid_load`.
double ambid_sample_time(const struct AmbidStepper *stepper);

// What went wrong in the last call of this thread that did; it lives until the next one that does.
const char *ambid_error(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* AMBID_H */

/* Steps a loop: each line of stdin is a sample of all inputs, each line of stdout one of all outputs.
 *
 *   cc -std=c99 -I rust/c/include rust/c/examples/step.c -L target/release -lambid -o step
 *   LD_LIBRARY_PATH=target/release ./step model.stepper < excitation.txt
 */
#include <stdio.h>
#include <stdlib.h>

#include "ambid.h"

static int failed(const char *what) {
    fprintf(stderr, "%s: %s\n", what, ambid_error());
    return EXIT_FAILURE;
}

int main(int argc, char **argv) {
    struct AmbidStepper *stepper = NULL;
    size_t inputs, outputs, i, read;
    double *u, *y;
    int status = EXIT_SUCCESS;

    if (argc != 2) {
        fprintf(stderr, "usage: %s FILE.stepper < excitation\n", argv[0]);
        return EXIT_FAILURE;
    }
    if (ambid_load(argv[1], &stepper) != AMBID_STATUS_OK) {
        return failed("load");
    }
    inputs = ambid_inputs(stepper);
    outputs = ambid_outputs(stepper);
    for (i = 0; i < outputs; i++) {
        fprintf(stderr, "%s%s", i > 0 ? " " : "", ambid_output_name(stepper, i));
    }
    fprintf(stderr, " every %g s\n", ambid_sample_time(stepper));
    u = calloc(inputs + 1, sizeof *u);
    y = calloc(outputs + 1, sizeof *y);
    while (u != NULL && y != NULL) {
        for (read = 0; read < inputs && scanf("%lf", &u[read]) == 1; read++) {
        }
        if (read < inputs) {
            break;
        }
        /* in a controller: called once a sample; it neither allocates nor waits */
        if (ambid_step(stepper, u, inputs, y, outputs) != AMBID_STATUS_OK) {
            status = failed("step");
            break;
        }
        for (i = 0; i < outputs; i++) {
            printf("%s%.17g", i > 0 ? " " : "", y[i]);
        }
        printf("\n");
    }
    free(u);
    free(y);
    ambid_free(stepper);
    return status;
}

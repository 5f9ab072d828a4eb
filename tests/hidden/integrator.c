/* A machine in time: x' = A x + B u + G w, the linear part exact, the signals w of its ports linear in each step.
 *
 * Time runs in pieces (a sample, or a turn of a faster controller) of n equal steps h. In a piece the inputs u are held.
 * Each step is x <- E x + F u + G0 w_start + G1 (w_end - w_start), with w_end from a first guess of the new x.
 * Matrices come as columns one after the other, each filled up to whole blocks of rows. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { DELAY, MAGNET, LIMIT, HYSTERESIS, FRICTION, POLYNOMIAL, CONTACT, DEAD_BAND, QUANTISER, RAMP, PARAMETRIC, SOFTENING,
       ASYMMETRY, FLUX, PRODUCT };
enum { PARAMETERS = 8, MEMORY = 8, STENCIL = 4, BLOCK = 16 };

typedef struct {
    int32_t states, inputs, ports, axes, outputs, controller_states;
    int32_t steps, pieces, samples, warm_up;   /* steps a piece, pieces a sample, all samples, those not recorded */
    double h;                                  /* s */
    const double *step;                        /* columns of x, u, w_start, w_end - w_start; `states` long each */
    const double *jump;                        /* column of each port: a unit jump inside the step (delays) */
    const double *z;                           /* columns of x, u, w; 2 x ports long: what the ports read */
    const double *out;                         /* columns of x, u, w; `outputs` long: y first */
    const int32_t *law;                        /* of each port */
    const double *parameters;                  /* PARAMETERS of each port */
    const double *A, *B, *C, *D;               /* discrete controller, row by row; A is NULL for an analog one */
} Machine;

typedef struct {
    const Machine *m;
    double *x, *guess, *u, *w, *w_end, *rise, *leap, *z;
    double *memory, *scratch;                  /* ports x MEMORY */
    double *history;                           /* ring of pieces, each (steps + 1) x ports: inputs of the delays */
    int32_t ring;
} Run;

static double clip(double v, double limit) { return v > limit ? limit : v < -limit ? -limit : v; }

/* Flux density over its linear value's unit against u, slope 1 at 0 and 1 at infinity: 0 linear, 1 tanh, 2 a blend of
 * Langevin's curve and a sharper knee that none of the closed formulas in use meets. */
double iron(int kind, double u) {
    if (kind == 0) return u;
    if (kind == 1) return tanh(u);
    double v = 3.0 * u, langevin = fabs(v) < 0.02 ? v / 3.0 - v * v * v / 45.0 : 1.0 / tanh(v) - 1.0 / v;
    return 0.6 * langevin + 0.4 * u / cbrt(1.0 + fabs(u * u * u));
}

/* Signal of a port that is no delay: what the physics adds to the linear machine. */
double port_law(int law, const double *p, const double *z, double t, double *memory) {
    double v = z[0], sum = 0.0;
    switch (law) {
    case MAGNET: {                             /* i0, gap, scale, K_i, K_s, iron, level, half difference of biases */
        double i = v / p[0], s = clip(z[1] / p[1], 0.95);
        double plus = iron((int)p[5], p[6] * (1.0 + p[7] + i) / (1.0 - s)) / p[6];
        double minus = iron((int)p[5], p[6] * (1.0 - p[7] - i) / (1.0 + s)) / p[6];
        double up = iron((int)p[5], p[6] * (1.0 + p[7])) / p[6], down = iron((int)p[5], p[6] * (1.0 - p[7])) / p[6];
        return p[2] * (plus * plus - minus * minus - up * up + down * down) - p[3] * v - p[4] * z[1];
    }
    case FLUX: {                               /* i0, gap, flux density of the iron's unit, -, -, iron, level */
        double i = v / p[0], s = clip(z[1] / p[1], 0.95);
        double plus = iron((int)p[5], p[6] * (1.0 + i) / (1.0 - s)), minus = iron((int)p[5], p[6] * (1.0 - i) / (1.0 + s));
        return p[2] * (plus - minus) / p[6];
    }
    case LIMIT: return clip(v, p[0]) - v;
    case HYSTERESIS:                           /* share, largest half-width: play operators in parallel */
        for (int k = 0; k < MEMORY; k++) {
            double r = p[1] * (k + 1) / MEMORY;
            memory[k] = fmin(fmax(memory[k], v - r), v + r);
            sum += v - memory[k];
        }
        return -p[0] * sum / MEMORY;
    case FRICTION: {                           /* force, stiffness before it slips, whether by Dahl; v across too */
        double m[2] = { memory[0], memory[1] }, d[2] = { v - m[0], z[1] - m[1] }, r = hypot(d[0], d[1]);
        if (p[2]) {                            /* spring force in memory 2, 3: it turns towards the way that was gone */
            double kept = exp(-p[1] / p[0] * r), gained = r > 0.0 ? p[0] * (1.0 - kept) / r : 0.0;
            for (int k = 0; k < 2; k++) memory[k] += d[k], memory[2 + k] = kept * memory[2 + k] + gained * d[k];
            return -memory[2];
        }
        if (r > p[0] / p[1])                   /* where the spring is held */
            for (int k = 0; k < 2; k++) memory[k] += d[k] * (1.0 - p[0] / p[1] / r);
        return -p[1] * (v - memory[0]);
    }
    case POLYNOMIAL: return (p[0] + p[1] * v) * v * v;
    case CONTACT: {                            /* stiffness, clearance, whether over the radius; v across too */
        double r = hypot(v, z[1]);
        return r > p[1] ? -p[0] * (r - p[1]) * v / (p[2] ? r * r : r) : 0.0;
    }
    case PRODUCT: return v * z[1];
    case DEAD_BAND: return -clip(v, p[0]);
    case QUANTISER: return p[0] * rint(v / p[0]) - v;
    case RAMP: return t > 0.0 ? p[0] * t / p[1] * v : 0.0;
    case PARAMETRIC: return p[0] * sin(p[1] * t) * v;
    case SOFTENING: return -v * fabs(v) / (p[0] + fabs(v));
    case ASYMMETRY: return p[0] * fabs(v);
    }
    return NAN;
}

/* Rows of a matrix in memory: whole blocks, the last one filled up with zeros. */
static int filled(int rows) { return (rows + BLOCK - 1) / BLOCK * BLOCK; }

/* sum += columns * by; a block of sums stays in registers. */
static void add_columns(double *restrict sum, const double *restrict columns, const double *restrict by, int rows, int n) {
    int stride = filled(rows);
    for (int i = 0; i < stride; i += BLOCK) {
        double block[BLOCK];
        memcpy(block, sum + i, sizeof block);
        for (int j = 0; j < n; j++)
            for (int k = 0; k < BLOCK; k++) block[k] += columns[(size_t)j * stride + i + k] * by[j];
        memcpy(sum + i, block, sizeof block);
    }
}

static double *node(const Run *r, long piece, int step) {
    const Machine *m = r->m;
    return r->history + ((piece + r->ring) % r->ring * (m->steps + 1) + step) * m->ports;
}

/* History of a delay's input at `local` steps after the start of a piece, by the cubic through the nearest of the nodes
 * 0 .. last of that piece; a piece never mixes with its neighbours, since everything held jumps in between. */
static double recall(const Run *r, int port, long piece, double local, int last) {
    int count = last + 1 < STENCIL ? last + 1 : STENCIL, first = (int)floor(local) - 1;
    double sum = 0.0;
    if (first > last + 1 - count) first = last + 1 - count;
    if (first < 0) first = 0;
    for (int a = first; a < first + count; a++) {
        double weight = 1.0;
        for (int b = first; b < first + count; b++) if (b != a) weight *= (local - b) / (a - b);
        sum += weight * node(r, piece, a)[port];
    }
    return sum;
}

/* What all ports read and give at node `at` of a piece, as the start of a step or as the end of one. At an end, a delayed
 * jump inside that step has happened (`after`) or is left out. */
static void evaluate(Run *r, const double *x, double *w, double *memory, long piece, int at, int start, int after) {
    const Machine *m = r->m;
    const double *of_w = m->z + (size_t)(m->states + m->inputs) * filled(2 * m->ports);
    double t = ((piece - (long)m->warm_up * m->pieces) * m->steps + at) * m->h;
    memset(r->z, 0, 2 * m->ports * sizeof(double));
    add_columns(r->z, m->z, x, 2 * m->ports, m->states);
    add_columns(r->z, m->z + (size_t)m->states * filled(2 * m->ports), r->u, 2 * m->ports, m->inputs);
    for (int j = 0; j < m->ports; j++) {
        const double *p = m->parameters + j * PARAMETERS;
        if (m->law[j] == DELAY) {
            node(r, piece, at)[j] = r->z[2 * j];
            /* the piece that the start of the step looks back to; its end may lie up to one step past it */
            double back = (start ? at : at - 1) - p[0] - p[1];
            long away = (long)floor(back / m->steps);
            double local = back - (double)away * m->steps + (start ? 0.0 : 1.0);
            if (!start && after && local > m->steps) away++, local -= m->steps;
            w[j] = recall(r, j, piece + away, local, away < 0 ? m->steps : at);
        } else {
            w[j] = port_law(m->law[j], p, r->z + 2 * j, t, memory + j * MEMORY);
        }
        add_columns(r->z, of_w + (size_t)j * filled(2 * m->ports), w + j, 2 * m->ports, 1);
    }
}

static void read_outputs(const Run *r, const double *w, double *out) {
    const Machine *m = r->m;
    memset(out, 0, m->outputs * sizeof(double));
    add_columns(out, m->out, r->x, m->outputs, m->states);
    add_columns(out, m->out + (size_t)m->states * filled(m->outputs), r->u, m->outputs, m->inputs);
    add_columns(out, m->out + (size_t)(m->states + m->inputs) * filled(m->outputs), w, m->outputs, m->ports);
}

/* Sampled controller: held command = -(C k + D y) + i_e, then k <- A k + B y. */
static void control(const Machine *m, double *k, double *next, const double *y, const double *i_e, double *held) {
    int n = m->controller_states, a = m->axes;
    for (int i = 0; i < a; i++) {
        double sum = 0.0;
        for (int j = 0; j < n; j++) sum += m->C[i * n + j] * k[j];
        for (int j = 0; j < a; j++) sum += m->D[i * a + j] * y[j];
        held[i] = i_e[i] - sum;
    }
    for (int i = 0; i < n; i++) {
        next[i] = 0.0;
        for (int j = 0; j < n; j++) next[i] += m->A[i * n + j] * k[j];
        for (int j = 0; j < a; j++) next[i] += m->B[i * a + j] * y[j];
    }
    memcpy(k, next, n * sizeof(double));
}

/* Whether a delayed jump falls inside the step that starts at node `at`. */
static int jumps(const Machine *m, int at) {
    for (int j = 0; j < m->ports; j++) {
        const double *p = m->parameters + j * PARAMETERS;
        if (m->law[j] == DELAY && p[1] > 0.0 && (at - (long)p[0]) % m->steps == 0) return 1;
    }
    return 0;
}

static void step(Run *r, long piece, int at) {
    const Machine *m = r->m;
    const double *of_u = m->step + (size_t)m->states * filled(m->states);
    const double *of_w = of_u + (size_t)m->inputs * filled(m->states);
    size_t ports = m->ports * sizeof(double), memory = (size_t)m->ports * MEMORY * sizeof(double);
    memset(r->guess, 0, m->states * sizeof(double));
    add_columns(r->guess, m->step, r->x, m->states, m->states);
    add_columns(r->guess, of_u, r->u, m->states, m->inputs);
    add_columns(r->guess, of_w, r->w, m->states, m->ports);
    if (m->ports) {
        memcpy(r->scratch, r->memory, memory);
        evaluate(r, r->guess, r->w_end, r->scratch, piece, at + 1, 0, 0);
        for (int j = 0; j < m->ports; j++) r->rise[j] = r->w_end[j] - r->w[j];
        memset(r->leap, 0, ports);
        if (jumps(m, at)) {
            memcpy(r->scratch, r->memory, memory);
            evaluate(r, r->guess, r->leap, r->scratch, piece, at + 1, 0, 1);
            for (int j = 0; j < m->ports; j++) r->leap[j] -= r->w_end[j];
        }
        add_columns(r->guess, of_w + (size_t)m->ports * filled(m->states), r->rise, m->states, m->ports);
        add_columns(r->guess, m->jump, r->leap, m->states, m->ports);
    }
    memcpy(r->x, r->guess, m->states * sizeof(double));
}

/* Run from x over `samples` rows of inputs (i_e, then noise of every axis); the rows after the warm-up are recorded.
 * Returns the samples done: fewer than `samples` when the rotor has left the machine. */
int32_t run(const Machine *m, double *x, const double *inputs, double *recorded) {
    int nw = m->ports + 1, ring = 2;
    for (int j = 0; j < m->ports; j++)
        if (m->law[j] == DELAY)
            ring = fmax(ring, 3 + (int)(m->parameters[j * PARAMETERS] / m->steps));
    size_t nodes = (size_t)ring * (m->steps + 1) * nw, memory = (size_t)nw * MEMORY;
    size_t rows = filled(m->states) + filled(2 * nw) + filled(m->outputs);
    double *pool = calloc(rows + m->inputs + 4 * nw + 2 * memory + nodes + 2 * m->controller_states, sizeof(double));
    double *p = pool;
    if (!pool) return -1;
    Run r = { .m = m, .x = x, .ring = ring };
    r.guess = p, p += filled(m->states), r.u = p, p += m->inputs, r.w = p, p += nw, r.w_end = p, p += nw, r.rise = p, p += nw;
    r.leap = p, p += nw, r.z = p, p += filled(2 * nw);
    r.memory = p, p += memory, r.scratch = p, p += memory, r.history = p, p += nodes;
    double *out = p, *k = p + filled(m->outputs), *next = k + m->controller_states;
    int32_t sample = 0;
    for (long piece = 0; sample < m->samples; sample++) {
        for (int turn = 0; turn < m->pieces; turn++, piece++) {
            memcpy(r.u, inputs + (size_t)sample * 2 * m->axes, 2 * m->axes * sizeof(double));
            if (m->A) {
                memcpy(r.scratch, r.memory, memory * sizeof(double));
                evaluate(&r, r.x, r.w, r.scratch, piece, 0, 1, 1);
                read_outputs(&r, r.w, out);
                control(m, k, next, out, r.u, r.u + 2 * m->axes);
            }
            for (int at = 0; at < m->steps; at++) {
                evaluate(&r, r.x, r.w, r.memory, piece, at, 1, 1);
                if (turn == 0 && at == 0) {
                    read_outputs(&r, r.w, out);
                    if (sample >= m->warm_up)
                        memcpy(recorded + (size_t)(sample - m->warm_up) * m->outputs, out, m->outputs * sizeof(double));
                }
                step(&r, piece, at);
            }
        }
        for (int i = 0; i < m->axes; i++)
            if (!(fabs(out[i]) < 0.1)) { free(pool); return sample; }
    }
    free(pool);
    return sample;
}

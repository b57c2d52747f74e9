/* An instance of a model: what FMI 2.0 and FMI 3.0 share.  The model itself is in model.h.
 *
 * Ticks are counted in whole numbers from the start.  The step sizes move the instance; the communication
 * points, which are rounded, only confirm where it is.  A communication step runs every tick that is due in
 * it, with the inputs at its beginning. */
#include <float.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { ESEA_OK, ESEA_DISCARD, ESEA_ERROR };
/* In ticks: how far from a boundary a point still counts as on it, and from where the last step ended.
 * Twice the coarsest spacing of numbers that a time may have. */
#define ESEA_TOLERANCE 0.02

enum { ESEA_CREATED, ESEA_INITIALIZING, ESEA_STEPPING, ESEA_TERMINATED };

/* All that changes: a state to come back to is a copy of this. */
typedef struct {
    int phase;
    int changed; /* parameters since the coefficients were made of them */
    double start_s;
    double now_s;
    double rounding_s; /* most that rounding can have moved the caller's points since the start */
    double ahead;      /* ticks from the end of the last tick that has run to now */
    uint32_t ticks;
    double value[MODEL_VARIABLES];
    model_t model;
} esea_snapshot_t;

typedef struct esea_instance {
    esea_snapshot_t now;
    int (*tell)(struct esea_instance *self, int status, const char *message);
    void *environment;
    const void *logger;
    int logging;
    char name[];
} esea_instance_t;

#define ESEA_TELL(self, status, ...) \
    (snprintf(esea_text, sizeof(esea_text), __VA_ARGS__), (self)->tell((self), (status), esea_text))
#define ESEA_TEXT char esea_text[256]

static int esea_phase(esea_instance_t *self, int first, int last, const char *what)
{
    static const char *const names[] = { "instantiated", "initializing", "stepping", "terminated" };
    ESEA_TEXT;

    if (self->now.phase >= first && self->now.phase <= last)
        return ESEA_OK;
    return ESEA_TELL(self, ESEA_ERROR, "%s: not while %s", what, names[self->now.phase]);
}

static void esea_restart(esea_instance_t *self)
{
    size_t k;

    memset(&self->now, 0, sizeof(self->now));
    for (k = 0; k < MODEL_VARIABLES; ++k)
        self->now.value[k] = model_variables[k].start;
    self->now.changed = 1;
}

/* NULL without memory.  Who calls it fills in tell, environment and logger. */
static esea_instance_t *esea_new(const char *name)
{
    const size_t length = strlen(name) + 1u;
    esea_instance_t *self = (esea_instance_t *)calloc(1u, sizeof(*self) + length);

    if (self != NULL) {
        memcpy(self->name, name, length);
        esea_restart(self);
    }
    return self;
}

/* Coefficients from the parameters, where these have changed; before the first tick the state as well. */
static int esea_prepare(esea_instance_t *self)
{
    ESEA_TEXT;

    if (!self->now.changed)
        return ESEA_OK;
    if (model_prepare(&self->now.model, self->now.value) != 0u)
        return ESEA_TELL(self, ESEA_ERROR, "the parameters are refused: one is outside its range");
    if (self->now.phase < ESEA_STEPPING)
        model_init(&self->now.model, self->now.value);
    self->now.changed = 0;
    return ESEA_OK;
}

static double esea_size(double x) { return x < 0.0 ? -x : x; }

/* The spacing of numbers at a time, rounded up; not finite for what is not finite. */
static double esea_spacing(double time_s) { return DBL_EPSILON * esea_size(time_s); }

/* Whether numbers at a time are fine enough to count ticks by. */
static int esea_countable(esea_instance_t *self, double time_s)
{
    ESEA_TEXT;

    if (esea_spacing(time_s) <= 0.5 * ESEA_TOLERANCE * MODEL_TICK_S)
        return ESEA_OK;
    return ESEA_TELL(self, ESEA_ERROR, "time %.17g s is not finite, or too large to count ticks of %g s", time_s,
                     (double)MODEL_TICK_S);
}

static int esea_initialize(esea_instance_t *self, double start_s)
{
    if (esea_phase(self, ESEA_CREATED, ESEA_CREATED, "initialization") != ESEA_OK
        || esea_countable(self, start_s) != ESEA_OK)
        return ESEA_ERROR;
    self->now.phase = ESEA_INITIALIZING;
    self->now.start_s = self->now.now_s = start_s;
    return ESEA_OK;
}

static int esea_initialized(esea_instance_t *self)
{
    if (esea_phase(self, ESEA_INITIALIZING, ESEA_INITIALIZING, "end of initialization") != ESEA_OK
        || esea_prepare(self) != ESEA_OK)
        return ESEA_ERROR;
    self->now.phase = ESEA_STEPPING;
    return ESEA_OK;
}

static int esea_get(esea_instance_t *self, unsigned reference, int whole, double *value)
{
    ESEA_TEXT;

    if (reference >= MODEL_VARIABLES)
        return ESEA_TELL(self, ESEA_ERROR, "there is no variable with value reference %u", reference);
    if (model_variables[reference].whole != whole)
        return ESEA_TELL(self, ESEA_ERROR, "%s is of another type", model_variables[reference].name);
    if (self->now.phase == ESEA_INITIALIZING && esea_prepare(self) != ESEA_OK)
        return ESEA_ERROR;
    *value = self->now.value[reference];
    return ESEA_OK;
}

/* An input may be anything, NaN included: the model replaces what is invalid.  A parameter may not. */
static int esea_set(esea_instance_t *self, unsigned reference, int whole, double value)
{
    const model_variable_t *variable;
    ESEA_TEXT;

    if (esea_phase(self, ESEA_CREATED, ESEA_STEPPING, "set") != ESEA_OK)
        return ESEA_ERROR;
    if (reference >= MODEL_VARIABLES)
        return ESEA_TELL(self, ESEA_ERROR, "there is no variable with value reference %u", reference);
    variable = &model_variables[reference];
    if (variable->whole != whole)
        return ESEA_TELL(self, ESEA_ERROR, "%s is of another type", variable->name);
    if (variable->causality == MODEL_OUTPUT)
        return ESEA_TELL(self, ESEA_ERROR, "%s is an output", variable->name);
    if (variable->causality == MODEL_FIXED && self->now.phase == ESEA_STEPPING)
        return ESEA_TELL(self, ESEA_ERROR, "%s can be set until initialization ends", variable->name);
    if (variable->causality != MODEL_INPUT) {
        if (!(value >= variable->low && value <= variable->high))
            return ESEA_TELL(self, ESEA_DISCARD, "%s = %.9g is outside %.9g to %.9g: it stays %.9g",
                             variable->name, value, variable->low, variable->high,
                             self->now.value[reference]);
        self->now.changed = 1;
    }
    self->now.value[reference] = value;
    return ESEA_OK;
}

static int esea_advance(esea_instance_t *self, double from_s, double step_s)
{
    const double limit_s = ESEA_TOLERANCE * MODEL_TICK_S;
    esea_snapshot_t *now = &self->now;
    double off_s, steps_s;
    ESEA_TEXT;

    if (esea_phase(self, ESEA_STEPPING, ESEA_STEPPING, "doStep") != ESEA_OK
        || esea_countable(self, from_s) != ESEA_OK)
        return ESEA_ERROR;
    off_s = from_s - now->now_s;
    if (!(esea_size(off_s) <= limit_s))
        return ESEA_TELL(self, ESEA_ERROR,
                         "doStep from %.17g s, but the instance is at %.17g s: %.3g s off, limit %.3g s", from_s,
                         now->now_s, off_s, limit_s);
    /* Each of the caller's sums may have been rounded, always to the same side. */
    steps_s = ((double)now->ticks + now->ahead) * MODEL_TICK_S;
    off_s = from_s - now->start_s - steps_s;
    if (!(esea_size(off_s) <= limit_s + now->rounding_s))
        return ESEA_TELL(self, ESEA_ERROR,
                         "doStep from %.17g s, but the steps since %.17g s add up to %.17g s: %.3g s off", from_s,
                         now->start_s, steps_s, off_s);
    if (!(step_s >= 0.0 && step_s / MODEL_TICK_S < 4294967294.0 - (double)now->ticks))
        return ESEA_TELL(self, ESEA_ERROR, "doStep by %.9g s: not finite, negative or too long", step_s);
    if (esea_prepare(self) != ESEA_OK)
        return ESEA_ERROR;
    now->ahead += step_s / MODEL_TICK_S;
    while (MODEL_DUE(now->ahead, ESEA_TOLERANCE)) {
        model_tick(&now->model, now->value, now->ticks);
        ++now->ticks;
        now->ahead -= 1.0;
    }
    now->now_s = from_s + step_s;
    now->rounding_s += esea_spacing(now->now_s);
    return ESEA_OK;
}

/* -- states ------------------------------------------------------------------------------------------ */

static esea_snapshot_t *esea_keep(esea_instance_t *self, esea_snapshot_t *kept)
{
    if (kept == NULL)
        kept = (esea_snapshot_t *)malloc(sizeof(*kept));
    if (kept != NULL)
        memcpy(kept, &self->now, sizeof(*kept));
    return kept;
}

typedef struct {
    char token[sizeof(MODEL_TOKEN)];
    uint64_t check;
    uint64_t size;
} esea_label_t;

#define ESEA_PACKED_SIZE (sizeof(esea_label_t) + sizeof(esea_snapshot_t))

/* FNV-1a, 64 bits. */
static uint64_t esea_check(const void *data, size_t size)
{
    const unsigned char *byte = (const unsigned char *)data;
    uint64_t sum = UINT64_C(14695981039346656037);

    while (size-- > 0u)
        sum = (sum ^ *byte++) * UINT64_C(1099511628211);
    return sum;
}

static int esea_pack(esea_instance_t *self, const esea_snapshot_t *kept, void *bytes, size_t size)
{
    esea_label_t label;
    ESEA_TEXT;

    if (kept == NULL || size < ESEA_PACKED_SIZE)
        return ESEA_TELL(self, ESEA_ERROR, "serialize: there is no state, or no room for it");
    memset(&label, 0, sizeof(label));
    memcpy(label.token, MODEL_TOKEN, sizeof(MODEL_TOKEN));
    label.check = esea_check(kept, sizeof(*kept));
    label.size = sizeof(*kept);
    memcpy(bytes, &label, sizeof(label));
    memcpy((char *)bytes + sizeof(label), kept, sizeof(*kept));
    return ESEA_OK;
}

static int esea_unpack(esea_instance_t *self, const void *bytes, size_t size, esea_snapshot_t **kept)
{
    const char *at = (const char *)bytes;
    esea_label_t label;
    ESEA_TEXT;

    if (size < ESEA_PACKED_SIZE)
        return ESEA_TELL(self, ESEA_ERROR, "deserialize: %lu bytes, not %lu", (unsigned long)size,
                         (unsigned long)ESEA_PACKED_SIZE);
    memcpy(&label, at, sizeof(label));
    if (memcmp(label.token, MODEL_TOKEN, sizeof(MODEL_TOKEN)) != 0 || label.size != sizeof(esea_snapshot_t))
        return ESEA_TELL(self, ESEA_ERROR, "deserialize: the state is of another model or content");
    if (esea_check(at + sizeof(label), sizeof(esea_snapshot_t)) != label.check)
        return ESEA_TELL(self, ESEA_ERROR, "deserialize: the state is damaged");
    if (*kept == NULL)
        *kept = (esea_snapshot_t *)malloc(sizeof(**kept));
    if (*kept == NULL)
        return ESEA_TELL(self, ESEA_ERROR, "out of memory");
    memcpy(*kept, at + sizeof(label), sizeof(**kept));
    return ESEA_OK;
}

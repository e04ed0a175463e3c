/* Lines of text from typed columns: the compiled twin of `reference` in opir_core.output.events.rendering.

   render(count, columns): each column is bytes, or a tuple of its kind and values: ("looked", texts, row or None),
   ("decimal", values, decimals), ("ids", words), ("times", unix_us). Returns None for numbers of 1e15 steps and more of
   the last decimal, which are left to the reference. The interpreter's lock is released while lines are written. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

enum { CONSTANT, LOOKED, DECIMAL, IDS, TIMES };

/* The longest texts of a number (sign, 16 digits, point, 22 zeros), an id and a time. */
enum { NUMBER_LENGTH = 48, ID_LENGTH = 36, TIME_LENGTH = 27, MOST_DECIMALS = 22 };

typedef struct {
    int kind, decimals, is_held;
    double scale;
    uint64_t one, least; /* the steps of 1, or more than any number has, and of 1e-5 */
    Py_ssize_t texts, longest;
    const char **text;
    Py_ssize_t *length;
    Py_buffer buffer;
} Column;

/* The texts of 0 to 99 in decimal digits and of 0 to 255 in hexadecimal ones. */
static char PAIR[200], HEX_PAIR[512];

static void set_pairs(void) {
    for (int number = 0; number < 256; number++) {
        HEX_PAIR[2 * number] = "0123456789abcdef"[number >> 4];
        HEX_PAIR[2 * number + 1] = "0123456789abcdef"[number & 15];
        if (number < 100) PAIR[2 * number] = (char)('0' + number / 10), PAIR[2 * number + 1] = (char)('0' + number % 10);
    }
}

static char *write_digits(char *at, uint64_t number, int digits) {
    int place = digits;
    for (; place >= 2; place -= 2, number /= 100) memcpy(at + place - 2, PAIR + 2 * (number % 100), 2);
    if (place) *at = (char)('0' + number % 10);
    return at + digits;
}

static uint64_t power_of_ten(int exponent) {
    uint64_t power = 1;
    for (; exponent > 0; exponent--) power *= 10;
    return power;
}

static int digits_of(uint64_t number) {
    int digits = 0;
    for (; number; number /= 10) digits++;
    return digits;
}

/* Rounds to even, as `nearbyint` without the call: exact below 2^51, and beyond not below 1e15. */
static double nearest(double value) { return (value + 0x1.8p52) - 0x1.8p52; }

/* A number of steps below 1e-5, as digits with an exponent. */
static char *write_small(char *at, uint64_t number, int decimals) {
    for (; number % 10 == 0; decimals--) number /= 10;
    char text[24] = "";
    int digits = digits_of(number), exponent = decimals + 1 - digits;
    write_digits(text, number, digits);
    *at++ = text[0];
    if (digits > 1) {
        *at++ = '.';
        at = (char *)memcpy(at, text + 1, (size_t)digits - 1) + digits - 1;
    }
    *at++ = 'e';
    *at++ = '-';
    return write_digits(at, (uint64_t)exponent, exponent >= 10 ? 2 : 1);
}

/* Writes |value| * 10^decimals, rounded to even, as the shortest decimal that reads back as the same double: below 1e15
   these are the digits without trailing zeros. Returns NULL from 1e15 on. */
static char *write_decimal(char *at, double value, const Column *column) {
    if (!isfinite(value)) return (char *)memcpy(at, "null", 4) + 4;
    double steps = nearest(value * column->scale);
    if (!(fabs(steps) < 1e15)) return NULL;
    uint64_t number = (uint64_t)fabs(steps), whole = number / column->one;
    if (number == 0) return (char *)memcpy(at, "0.0", 3) + 3;
    if (steps < 0) *at++ = '-';
    if (number < column->least) return write_small(at, number, column->decimals);
    at = write_digits(at, whole, whole < 10 ? 1 : digits_of(whole));
    *at++ = '.';
    char *first = at;
    at = write_digits(at, number - whole * column->one, column->decimals ? column->decimals : 1);
    while (at - first > 1 && at[-1] == '0') at--;
    return at;
}

static char *write_id(char *at, const uint64_t *words) {
    for (int place = 0; place < 16; place++) {
        if (place == 4 || place == 6 || place == 8 || place == 10) *at++ = '-';
        at = (char *)memcpy(at, HEX_PAIR + 2 * (words[place / 8] >> (56 - 8 * (place % 8)) & 255), 2) + 2;
    }
    return at;
}

static char *write_pair(char *at, int64_t number, char after) {
    memcpy(at, PAIR + 2 * number, 2);
    at[2] = after;
    return at + 3;
}

/* Year, month and day of days since 1970-01-01: H. Hinnant, "chrono-compatible low-level date algorithms", 2014. */
static char *write_time(char *at, int64_t unix_us) {
    int64_t seconds = unix_us / 1000000, rest = unix_us % 1000000;
    if (rest < 0) { rest += 1000000; seconds--; }
    int64_t days = seconds / 86400, second = seconds % 86400;
    if (second < 0) { second += 86400; days--; }
    days += 719468;
    int64_t era = days / 146097, of_era = days % 146097; /* the years 1 to 9999: days are positive */
    int64_t year = (of_era - of_era / 1460 + of_era / 36524 - of_era / 146096) / 365;
    int64_t of_year = of_era - (365 * year + year / 4 - year / 100), month = (5 * of_year + 2) / 153;
    int64_t day = of_year - (153 * month + 2) / 5 + 1;
    month = month < 10 ? month + 3 : month - 9;
    year += era * 400 + (month <= 2);
    at = write_pair(write_pair(at, year / 100 % 100, 0) - 1, year % 100, '-');
    at = write_pair(write_pair(at, month, '-'), day, 'T');
    at = write_pair(write_pair(at, second / 3600, ':'), second / 60 % 60, ':');
    at = write_pair(write_pair(at, second % 60, '.'), rest / 10000, 0) - 1;
    return write_pair(write_pair(at, rest / 100 % 100, 0) - 1, rest % 100, 'Z');
}

static char *write_value(char *at, const Column *column, Py_ssize_t line) {
    Py_ssize_t text = line;
    switch (column->kind) {
    case DECIMAL: return write_decimal(at, ((const double *)column->buffer.buf)[line], column);
    case IDS: return write_id(at, (const uint64_t *)column->buffer.buf + 2 * line);
    case TIMES: return write_time(at, ((const int64_t *)column->buffer.buf)[line]);
    case CONSTANT: text = 0; break;
    default: if (column->is_held) text = (Py_ssize_t)((const int64_t *)column->buffer.buf)[line];
    }
    memcpy(at, column->text[text], (size_t)column->length[text]);
    return at + column->length[text];
}

static char *write_lines(char *at, const Column *columns, Py_ssize_t width, Py_ssize_t count) {
    for (Py_ssize_t line = 0; line < count && at; line++)
        for (Py_ssize_t place = 0; place < width && at; place++) at = write_value(at, columns + place, line);
    return at;
}

static int set_texts(Column *column, PyObject *const *items, Py_ssize_t texts) {
    column->text = PyMem_New(const char *, texts + 1);
    column->length = PyMem_New(Py_ssize_t, texts + 1);
    if (!column->text || !column->length) { PyErr_NoMemory(); return -1; }
    column->texts = texts;
    for (Py_ssize_t place = 0; place < texts; place++) {
        if (PyBytes_AsStringAndSize(items[place], (char **)&column->text[place], &column->length[place])) return -1;
        if (column->length[place] > column->longest) column->longest = column->length[place];
    }
    return 0;
}

static int set_buffer(Column *column, PyObject *values, Py_ssize_t bytes) {
    if (PyObject_GetBuffer(values, &column->buffer, PyBUF_C_CONTIGUOUS)) return -1;
    column->is_held = 1;
    if (column->buffer.len == bytes) return 0;
    PyErr_SetString(PyExc_ValueError, "a column has not one row of 8 bytes (ids: 16) per line");
    return -1;
}

static int set_looked(Column *column, PyObject *texts, PyObject *row, Py_ssize_t count) {
    if (!PyList_Check(texts)) { PyErr_SetString(PyExc_TypeError, "texts must be a list"); return -1; }
    if (set_texts(column, ((PyListObject *)texts)->ob_item, PyList_GET_SIZE(texts))) return -1;
    int is_within = row != Py_None || column->texts == count;
    if (row != Py_None) {
        if (set_buffer(column, row, 8 * count)) return -1;
        const int64_t *rows = (const int64_t *)column->buffer.buf;
        for (Py_ssize_t line = 0; line < count; line++) is_within &= rows[line] >= 0 && rows[line] < column->texts;
    }
    if (!is_within) PyErr_SetString(PyExc_IndexError, "a row has no text");
    return is_within ? 0 : -1;
}

static int set_column(Column *column, PyObject *given, Py_ssize_t count) {
    if (PyBytes_Check(given)) return set_texts(column, &given, 1);
    const char *kind;
    PyObject *values, *more = Py_None;
    if (!PyArg_ParseTuple(given, "sO|O", &kind, &values, &more)) return -1;
    column->longest = NUMBER_LENGTH;
    if (!strcmp(kind, "looked")) { column->kind = LOOKED; column->longest = 0; return set_looked(column, values, more, count); }
    if (!strcmp(kind, "ids")) { column->kind = IDS; return set_buffer(column, values, 16 * count); }
    if (!strcmp(kind, "times")) { column->kind = TIMES; return set_buffer(column, values, 8 * count); }
    column->kind = DECIMAL;
    long decimals = PyLong_AsLong(more);
    if (PyErr_Occurred()) return -1;
    if (decimals < 0 || decimals > MOST_DECIMALS) { PyErr_SetString(PyExc_ValueError, "0 to 22 decimals"); return -1; }
    column->decimals = (int)decimals;
    column->scale = pow(10.0, (double)decimals);
    column->one = power_of_ten(decimals < 19 ? (int)decimals : 19);
    column->least = decimals > 5 ? power_of_ten((int)decimals - 5) : 0;
    return set_buffer(column, values, 8 * count);
}

static PyObject *rendered(PyObject *columns_given, Py_ssize_t count, Column *columns, Py_ssize_t width) {
    Py_ssize_t longest = 0;
    for (Py_ssize_t place = 0; place < width; place++) {
        if (set_column(columns + place, PyList_GET_ITEM(columns_given, place), count)) return NULL;
        longest += columns[place].longest;
    }
    /* Not shrunk in place: memory of one size is used again, while that of a shrunk block comes new from the system. */
    char *end, *start = PyMem_RawMalloc((size_t)(longest * count) + 1);
    if (!start) return PyErr_NoMemory();
    Py_BEGIN_ALLOW_THREADS
    end = write_lines(start, columns, width, count);
    Py_END_ALLOW_THREADS
    PyObject *lines = end ? PyBytes_FromStringAndSize(start, end - start) : Py_NewRef(Py_None);
    PyMem_RawFree(start);
    return lines;
}

static PyObject *render(PyObject *module, PyObject *arguments) {
    (void)module;
    Py_ssize_t count;
    PyObject *given;
    if (!PyArg_ParseTuple(arguments, "nO!", &count, &PyList_Type, &given)) return NULL;
    Py_ssize_t width = PyList_GET_SIZE(given);
    Column *columns = PyMem_Calloc((size_t)width + 1, sizeof(Column));
    if (!columns) return PyErr_NoMemory();
    PyObject *lines = rendered(given, count, columns, width);
    for (Py_ssize_t place = 0; place < width; place++) {
        if (columns[place].is_held) PyBuffer_Release(&columns[place].buffer);
        PyMem_Free(columns[place].text);
        PyMem_Free(columns[place].length);
    }
    PyMem_Free(columns);
    return lines;
}

static PyMethodDef METHODS[] = {{"render", render, METH_VARARGS, "Return lines, or None for the reference."}, {0}};
static struct PyModuleDef MODULE = {PyModuleDef_HEAD_INIT, "compiled", NULL, -1, METHODS, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit_compiled(void) {
    set_pairs();
    return PyModule_Create(&MODULE);
}

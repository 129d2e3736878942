/* The tip of an arm of six joints, each of its 30 parameters a fourth-order polynomial of its
 * joint's temperature: what the kernel computes, written by hand.
 *
 * A joint is Rz(q + theta) Tz(d) Tx(a) Rx(alpha) Ry(beta); parameters p[6][5] = theta, d, a,
 * alpha, beta; polynomials c[6][5][4] multiply t, t^2, t^3, t^4, t = temperature - reference.
 */
#include <math.h>

enum { JOINTS = 6, BLOCK = 64 };

typedef double parameters[JOINTS][5];
typedef double polynomials[JOINTS][5][4];

static void at_temperature(const parameters p, const polynomials c, const double *t, parameters out)
{
    for (int k = 0; k < JOINTS; k++)
        for (int j = 0; j < 5; j++) {
            const double *a = c[k][j];
            out[k][j] = p[k][j] + t[k] * (a[0] + t[k] * (a[1] + t[k] * (a[2] + t[k] * a[3])));
        }
}

static void chain(const double *q, const parameters p, const double *tip, double *position)
{
    double x = tip[0], y = tip[1], z = tip[2], u;
    for (int k = JOINTS - 1; k >= 0; k--) {
        double s = sin(p[k][4]), c = cos(p[k][4]);
        u = c * x + s * z;
        z = c * z - s * x;
        x = u + p[k][2];
        s = sin(p[k][3]);
        c = cos(p[k][3]);
        u = c * y - s * z;
        z = s * y + c * z + p[k][1];
        y = u;
        s = sin(q[k] + p[k][0]);
        c = cos(q[k] + p[k][0]);
        u = c * x - s * y;
        y = s * x + c * y;
        x = u;
    }
    position[0] = x;
    position[1] = y;
    position[2] = z;
}

/* As one writes it first: sample after sample, every parameter from its temperature. */
void one_by_one(long n, const double *q, const double *t, const double *p, const double *c,
                const double *tip, double *position)
{
    parameters warm;
    for (long i = 0; i < n; i++) {
        at_temperature((const double (*)[5])p, (const double (*)[5][4])c, t + JOINTS * i, warm);
        chain(q + JOINTS * i, (const double (*)[5])warm, tip, position + 3 * i);
    }
}

/* One temperature for all samples, folded into one 3 x 4 matrix per joint; blocks of 64 samples
 * as structure of arrays, every loop over the samples left to the vectoriser and to libmvec. */
void in_blocks(long n, const double *q, const double *t, const double *p, const double *c,
               const double *tip, double *position)
{
    parameters warm;
    double m[JOINTS][3][4];
    at_temperature((const double (*)[5])p, (const double (*)[5][4])c, t, warm);
    for (int k = 0; k < JOINTS; k++) {
        const double *w = warm[k];
        double st = sin(w[0]), ct = cos(w[0]);
        double sa = sin(w[3]), ca = cos(w[3]), sb = sin(w[4]), cb = cos(w[4]);
        double rows[3][4] = {
            {ct * cb - st * sa * sb, -st * ca, ct * sb + st * sa * cb, ct * w[2]},
            {st * cb + ct * sa * sb, ct * ca, st * sb - ct * sa * cb, st * w[2]},
            {-ca * sb, sa, ca * cb, w[1]},
        };
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 4; j++)
                m[k][i][j] = rows[i][j];
    }
    for (long start = 0; start < n; start += BLOCK) {
        const int b = n - start < BLOCK ? (int)(n - start) : BLOCK;
        double angle[JOINTS][BLOCK], s[JOINTS][BLOCK], co[JOINTS][BLOCK];
        double x[BLOCK], y[BLOCK], z[BLOCK];
        for (int i = 0; i < b; i++)
            for (int k = 0; k < JOINTS; k++)
                angle[k][i] = q[JOINTS * (start + i) + k];
        for (int k = 0; k < JOINTS; k++) {
            for (int i = 0; i < b; i++)
                s[k][i] = sin(angle[k][i]);
            for (int i = 0; i < b; i++)
                co[k][i] = cos(angle[k][i]);
        }
        for (int i = 0; i < b; i++) {
            x[i] = tip[0];
            y[i] = tip[1];
            z[i] = tip[2];
        }
        for (int k = JOINTS - 1; k >= 0; k--) {
            const double(*r)[4] = m[k];
            for (int i = 0; i < b; i++) {
                double along = r[0][0] * x[i] + r[0][1] * y[i] + r[0][2] * z[i] + r[0][3];
                double across = r[1][0] * x[i] + r[1][1] * y[i] + r[1][2] * z[i] + r[1][3];
                z[i] = r[2][0] * x[i] + r[2][1] * y[i] + r[2][2] * z[i] + r[2][3];
                x[i] = co[k][i] * along - s[k][i] * across;
                y[i] = s[k][i] * along + co[k][i] * across;
            }
        }
        for (int i = 0; i < b; i++) {
            position[3 * (start + i)] = x[i];
            position[3 * (start + i) + 1] = y[i];
            position[3 * (start + i) + 2] = z[i];
        }
    }
}

/* Nothing but fused multiply-adds in registers, enough of them at once to hide their latency: what
 * the machine can do. Returns operations, of which each multiply-add is two; *out keeps them alive. */
#ifdef __AVX512F__
typedef double lanes __attribute__((vector_size(64)));
#else
typedef double lanes __attribute__((vector_size(32)));
#endif

double multiply_add(long n, double by, double *out)
{
    enum { CHAINS = 12 };
    lanes sums[CHAINS], more = {0}, factor = {0};
    factor += by;
    more += 1e-9;
    for (int k = 0; k < CHAINS; k++)
        sums[k] = more * k;
    for (long i = 0; i < n; i++)
        for (int k = 0; k < CHAINS; k++)
            sums[k] = sums[k] * factor + more;
    for (int k = 0; k < CHAINS; k++)
        *out += sums[k][0];
    return 2.0 * n * CHAINS * (sizeof(lanes) / sizeof(double));
}

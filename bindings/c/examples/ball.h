/* A soft ball for the examples: a surface, and what was measured at six points of it.
 *
 * It is half as stiff again on one side as on the other. A body of your own comes from a mesh and samples of yours in the same way, or
 * from a file: palpate_body_open("liver.body", ...). */

#ifndef BALL_H
#define BALL_H

#include "palpate.h"

#include <math.h>

#define BALL_RADIUS_M 0.03
#define BALL_RINGS 24  /* between the poles */
#define BALL_AROUND 48 /* vertices of a ring */
#define BALL_VERTICES (2 + BALL_RINGS * BALL_AROUND)
#define BALL_TRIANGLES (2 * BALL_AROUND * BALL_RINGS)
#define BALL_DEPTHS 4
#define BALL_ROWS (6 * (2 * BALL_DEPTHS + 1))

/* Makes it, and writes a handle to *body. */
static palpate_status make_ball(palpate_body *body, palpate_error *error)
{
    static double positions[BALL_VERTICES][3];
    static uint32_t triangles[BALL_TRIANGLES][3];
    static palpate_sample_row rows[BALL_ROWS];
    static const double points[6][3] = {{0, 0, 1}, {0, 0, -1}, {1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}};
    const double pi = 3.14159265358979323846;
    const uint32_t south = BALL_VERTICES - 1;
    palpate_body_arrays arrays = PALPATE_BODY_ARRAYS_INIT;
    uint32_t r, k, n = 0;
    int p, d, row = 0;

    positions[0][2] = BALL_RADIUS_M;
    positions[south][2] = -BALL_RADIUS_M;
    for (r = 0; r < BALL_RINGS; r++) {
        const double polar = pi * (r + 1) / (BALL_RINGS + 1);
        for (k = 0; k < BALL_AROUND; k++) {
            double *v = positions[1 + r * BALL_AROUND + k];
            const double around = 2 * pi * k / BALL_AROUND;
            v[0] = BALL_RADIUS_M * sin(polar) * cos(around);
            v[1] = BALL_RADIUS_M * sin(polar) * sin(around);
            v[2] = BALL_RADIUS_M * cos(polar);
        }
    }
    for (k = 0; k < BALL_AROUND; k++) {
        const uint32_t next = (k + 1) % BALL_AROUND, last = 1 + (BALL_RINGS - 1) * BALL_AROUND;
        const uint32_t caps[2][3] = {{0, 1 + k, 1 + next}, {south, last + next, last + k}};
        for (r = 0; r < 2; r++, n++)
            for (d = 0; d < 3; d++)
                triangles[n][d] = caps[r][d];
        for (r = 0; r + 1 < BALL_RINGS; r++) {
            const uint32_t a = 1 + r * BALL_AROUND, b = a + BALL_AROUND;
            const uint32_t pair[2][3] = {{a + k, b + k, b + next}, {a + k, b + next, a + next}};
            int half;
            for (half = 0; half < 2; half++, n++)
                for (d = 0; d < 3; d++)
                    triangles[n][d] = pair[half][d];
        }
    }
    for (p = 0; p < 6; p++) {
        const double stiffness = points[p][0] > 0 ? 1.5 : 1.0;
        for (d = 0; d <= 2 * BALL_DEPTHS; d++, row++) {
            palpate_sample_row *sample = &rows[row];
            const double deflection = 2e-3 * (d < BALL_DEPTHS ? d + 1 : d - BALL_DEPTHS + 1);
            int axis;
            sample->point = (uint32_t)p;
            for (axis = 0; axis < 3; axis++)
                sample->position_m[axis] = BALL_RADIUS_M * points[p][axis];
            if (d < BALL_DEPTHS) { /* N, growing with the square of the depth */
                sample->component = PALPATE_NORMAL;
                sample->deflection_m = deflection;
                sample->value = stiffness * 6e4 * deflection * deflection;
            } else if (d < 2 * BALL_DEPTHS) { /* N */
                sample->component = PALPATE_LATERAL;
                sample->deflection_m = deflection;
                sample->value = stiffness * 400 * deflection;
            } else { /* a coefficient */
                sample->component = PALPATE_FRICTION;
                sample->deflection_m = 2e-3;
                sample->value = 0.3;
            }
        }
    }
    arrays.positions_m = &positions[0][0];
    arrays.vertex_count = BALL_VERTICES;
    arrays.triangles = &triangles[0][0];
    arrays.triangle_count = BALL_TRIANGLES;
    arrays.samples = rows;
    arrays.sample_count = BALL_ROWS;
    return palpate_body_from_arrays(&arrays, body, error);
}

#endif

/* palpate in the place of a proxy algorithm (god-object) in a haptic loop that is there already.
 *
 * The loop below is the usual one: read the device, scale its workspace, find the proxy's goal, move the proxy, render
 * stiffness * (proxy - goal). Only `render` differs: `proxy_render` is what was there, `palpate_render` what comes in its place, with the
 * same words. Both run here side by side on one ball.
 *
 *   device   where the handle is, in the device's frame
 *   goal     where the tool is in the scene: the device times the workspace scale. palpate's tool position.
 *   proxy    the point that stays on the surface. palpate's contact point, at rest and deflected.
 *   stiffness, friction   of the material, one number each. In palpate they are the body's: curves, other at every place. */

#include "ball.h"

#include <stdio.h>

static const double workspace_scale = 0.5; /* the scene moves half as far as the handle */

/* What was there: the proxy on a ball of one stiffness, without friction. */
struct proxy_algorithm {
    double stiffness_n_per_m;
    double proxy[3];
};

static void proxy_render(struct proxy_algorithm *scene, const double goal[3], double force[3])
{
    const double r = sqrt(goal[0] * goal[0] + goal[1] * goal[1] + goal[2] * goal[2]);
    int i;
    for (i = 0; i < 3; i++) {
        scene->proxy[i] = r < BALL_RADIUS_M ? goal[i] * (BALL_RADIUS_M / r) : goal[i];
        force[i] = scene->stiffness_n_per_m * (scene->proxy[i] - goal[i]);
    }
}

/* What comes in its place. The contact holds the proxy, and all else that lasts from one sample to the next. */
static int palpate_render(palpate_contact contact, const double goal[3], double dt_s, double force[3], double proxy[3])
{
    palpate_tool_state tool = PALPATE_TOOL_STATE_INIT;
    palpate_output output = PALPATE_OUTPUT_INIT;
    int i;
    for (i = 0; i < 3; i++)
        tool.position_m[i] = goal[i];
    if (palpate_contact_step(contact, &tool, dt_s, &output) != PALPATE_STATUS_OK)
        return 1;
    for (i = 0; i < 3; i++) {
        force[i] = output.force_n[i];
        proxy[i] = output.flags & PALPATE_FLAG_IN_CONTACT ? output.contact_position_m[i] : goal[i];
    }
    return 0;
}

/* The device: a formula stands for it. It presses the handle down by 14 mm and moves it aside by 20 mm. */
static void read_device(int sample, double handle[3])
{
    const double t = sample / 1000.0;
    handle[0] = t < 0.5 ? 0.0 : 40e-3 * (t - 0.5);
    handle[1] = 0.0;
    handle[2] = 2 * BALL_RADIUS_M + 4e-3 - 14e-3 * (t < 0.5 ? t / 0.5 : 1.0);
}

int main(void)
{
    struct proxy_algorithm scene = {300.0, {0, 0, 0}};
    palpate_error error = PALPATE_ERROR_INIT;
    palpate_body body;
    palpate_contact contact;
    double felt = 0.0, aside = 0.0;
    int sample, i;

    if (make_ball(&body, &error) || palpate_contact_create(body, NULL, &contact, &error)) {
        fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    for (sample = 0; sample < 1000; sample++) {
        double handle[3], goal[3], before[3], force[3], proxy[3];
        read_device(sample, handle);
        for (i = 0; i < 3; i++)
            goal[i] = workspace_scale * handle[i];
        proxy_render(&scene, goal, before);
        if (palpate_render(contact, goal, 1e-3, force, proxy))
            return 1;
        /* A force in the scene is rendered as it is; scaled positions with unscaled forces make the handle feel the body softer by the
         * scale. */
        if (sample % 100 == 99)
            printf("goal %6.2f %6.2f mm | proxy algorithm: proxy %6.2f %6.2f mm, %6.3f %6.3f N | palpate: %6.2f %6.2f mm, "
                   "%6.3f %6.3f N\n",
                   1e3 * goal[0], 1e3 * goal[2], 1e3 * scene.proxy[0], 1e3 * scene.proxy[2], before[0], before[2],
                   1e3 * proxy[0], 1e3 * proxy[2], force[0], force[2]);
        felt = force[2] > felt ? force[2] : felt;
        aside = force[0] < aside ? force[0] : aside;
    }
    palpate_contact_close(contact);
    palpate_body_close(body);
    /* It pushes back, and friction drags against the motion. */
    return felt > 0.5 && aside < -0.05 ? 0 : 1;
}

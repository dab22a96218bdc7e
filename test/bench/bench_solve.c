/* bench_solve.c - median time [ms] of factor and solve for each linear solver on the shapes catnav meets:
 * a catheter (455 stations of 7 nodes), an artery wall, a compact cube. Run: bench_solve [repeats]. */
#include <stdio.h>
#include <time.h>

#include "../core/solve_cases.h"
#include "solve.h"

static double now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e3 * (double)t.tv_sec + 1e-6 * (double)t.tv_nsec;
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *v, int n)
{
    qsort(v, (size_t)n, sizeof *v, compare);
    return v[n / 2];
}

static double stiffness; /* Young's modulus [Pa] */

static double young(const cn_body *body, int e)
{
    (void)body, (void)e;
    return stiffness;
}

static void bench(const char *name, cn_body body, int stations, double modulus, int repeats)
{
    static const char *const kinds[] = {"auto", "cholesky", "cg", "chain", "pcg"};
    const cn_body *const bodies[] = {&body};
    const size_t n3 = 3 * (size_t)body.nnode;
    double *b = malloc(n3 * sizeof *b), *x = malloc(n3 * sizeof *x), factor[1000], solve[1000], product[1000];
    cn_matrix *a;
    int *level = malloc((size_t)body.nnode * sizeof *level);

    if (!b || !x || !level || cn_matrix_new(&a, 1, bodies, (int[]){0}) != CN_OK) exit(1);
    for (int i = 0; i < body.nnode; i++)
        level[i] = i / (body.nnode / stations);
    stiffness = modulus;
    add_elastic(a, &body, young, 0.45, 1100, 1e4); /* dt = 10 ms */
    for (size_t k = 0; k < n3; k++)
        b[k] = 1e-6 * cos(0.1 * (double)k);
    printf("%s: %d nodes, %d tetrahedra, %d blocks\n", name, body.nnode, body.ntet, a->nblock);
    for (int kind = CN_LINEAR_AUTO; kind <= CN_LINEAR_PCG; kind++)
        for (int threads = 1; threads <= 2; threads++) {
            cn_solver *solver;
            cn_pool *pool;
            int iterations = 0, runs = 0;
            double residual = 0;
            const double begin = now_ms();
            if (cn_solver_new(&solver, a, kind, level, NULL) != CN_OK) exit(1);
            const double analysis = now_ms() - begin;
            if (cn_pool_new(&pool, threads) != CN_OK) exit(1);
            for (double start = now_ms(); runs < repeats && (runs < 1 || now_ms() - start < 2000); runs++) {
                const double t0 = now_ms();
                const cn_status status = cn_solver_factor(solver, a, body.nnode, NULL, pool);
                const double t1 = now_ms();
                if (kind == CN_LINEAR_CG || kind == CN_LINEAR_PCG) memset(x, 0, n3 * sizeof *x);
                if (status != CN_OK) exit(1);
                if (kind == CN_LINEAR_CG || kind == CN_LINEAR_PCG)
                    cn_solver_solve(solver, b, x, 1e-3, 3000, &iterations, &residual, pool);
                else
                    cn_solver_solve(solver, b, x, 0, 0, NULL, NULL, pool);
                const double t2 = now_ms();
                cn_matrix_multiply(a, body.nnode, x, x == b ? x : b, NULL);
                const double t3 = now_ms();
                for (size_t k = 0; k < n3; k++)
                    b[k] = 1e-6 * cos(0.1 * (double)k);
                factor[runs] = t1 - t0, solve[runs] = t2 - t1, product[runs] = t3 - t2;
            }
            if (kind != CN_LINEAR_CG && kind != CN_LINEAR_PCG)
                cn_solver_solve(solver, b, x, 1, 0, &iterations, &residual, pool);
            printf(
                "  %-8s threads %d: analysis %7.1f  factor %8.3f  solve %8.3f  (A x %.3f)  residual %.1e, %d "
                "iterations%s\n",
                kinds[kind + 1], threads, analysis, median(factor, runs), median(solve, runs),
                median(product, runs), residual, iterations,
                kind == CN_LINEAR_AUTO
                    ? (cn_solver_kind(solver) == CN_LINEAR_CHAIN ? " = chain" : " = cholesky")
                    : "");
            cn_solver_free(solver);
            cn_pool_free(pool);
        }
    cn_matrix_free(a);
    free(b);
    free(x);
    free(level);
    body_drop(&body);
}

int main(int argc, char **argv)
{
    int repeats = argc > 1 ? atoi(argv[1]) : 200;

    if (repeats < 1 || repeats > 1000) repeats = 200;
    bench("catheter", body_sweep(section_disc(6, 0.675e-3), 455, 1.0), 455, 8.7e6, repeats);
    bench("catheter, finer section", body_sweep(section_disc(12, 0.675e-3), 455, 1.0), 455, 8.7e6, repeats);
    bench("artery wall", body_sweep(section_ring(28, 10e-3, 11e-3), 149, 0.3), 149, 1e6, repeats);
    bench("snake", body_sweep(section_square(4, 0.02), 278, 1.0), 278, 5e5, repeats);
    bench("compact cube", body_sweep(section_square(16, 0.2), 17, 0.2), 17, 5e7, repeats);
    return 0;
}

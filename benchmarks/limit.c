/* The limit of bench_limit.py: recursive least squares of ARX[2,2] for 16 lanes, vectorised by hand.

   The upper triangle of P, nothing else: no missing values, no protection against poor excitation,
   no choice of orders. Vectors of V lanes; the path of theta is stored. P is kept as it is after
   forgetting, P o S, where S_ij = 1 / sqrt(lambda_i lambda_j), so that one form serves both. */

#define LANES 16
#define M (LANES / V)

typedef double vec __attribute__((vector_size(8 * V), aligned(8)));

static const int UPPER[4][4] = {{0, 1, 2, 3}, {1, 4, 5, 6}, {2, 5, 7, 8}, {3, 6, 8, 9}};

static inline __attribute__((always_inline)) vec at(const double *row, int m, int shared)
{
    return shared ? (vec){} + row[0] : *(const vec *)(row + V * m);
}

static inline __attribute__((always_inline)) void
recursion(const double *e, const double *u, int n, int nk, const double *lambda, double p0,
          double *path, int shared, int by_parameter)
{
    const int W = shared ? 1 : LANES;
    vec P[10][M], S[10][M], theta[4][M];
    for (int i = 0; i < 4; i++)
        for (int k = i; k < 4; k++)
            for (int m = 0; m < M; m++)
                for (int j = 0; j < V; j++) {
                    const double *of = lambda + V * m + j;
                    S[UPPER[i][k]][m][j] =
                        1.0 / __builtin_sqrt(of[LANES * i] * of[LANES * k]);
                    P[UPPER[i][k]][m][j] = i == k ? p0 * S[UPPER[i][k]][m][j] : 0.0;
                    theta[i][m][j] = 0.0;
                }
    for (int t = nk + 1; t < n; t++) {
        double *out = path + (long)4 * LANES * t;
        for (int m = 0; m < M; m++) {
            vec phi[4] = {-at(u + (long)W * (t - 1), m, shared), -at(u + (long)W * (t - 2), m, shared),
                          at(e + (long)W * (t - nk), m, shared), at(e + (long)W * (t - nk - 1), m, shared)};
            vec g[4];
            for (int i = 0; i < 4; i++)
                g[i] = P[UPPER[i][0]][m] * phi[0] + P[UPPER[i][1]][m] * phi[1]
                     + P[UPPER[i][2]][m] * phi[2] + P[UPPER[i][3]][m] * phi[3];
            vec alpha = 1.0 + ((phi[0] * g[0] + phi[1] * g[1]) + (phi[2] * g[2] + phi[3] * g[3]));
            vec error = at(u + (long)W * t, m, shared)
                      - ((phi[0] * theta[0][m] + phi[1] * theta[1][m])
                         + (phi[2] * theta[2][m] + phi[3] * theta[3][m]));
            vec inverse = 1.0 / alpha;
            for (int i = 0; i < 4; i++) {
                vec gain = g[i] * inverse;
                theta[i][m] += gain * error;
                *(vec *)(out + LANES * i + V * m) = theta[i][m];
                for (int k = i; k < 4; k++) {
                    int at_ik = UPPER[i][k];
                    P[at_ik][m] = (P[at_ik][m] - gain * g[k]) * S[by_parameter ? at_ik : 0][m];
                }
            }
        }
    }
}

/* e and u of shape (n, 1 if shared or 16), lambda of shape (4, 16), path of shape (n, 4, 16). */
#define DEFINE(name, shared, by_parameter)                                                         \
    void name(const double *e, const double *u, int n, int nk, const double *lambda, double p0,    \
              double *path)                                                                        \
    {                                                                                              \
        recursion(e, u, n, nk, lambda, p0, path, shared, by_parameter);                            \
    }

DEFINE(runs, 0, 0)
DEFINE(settings, 1, 0)
DEFINE(runs_by_parameter, 0, 1)
DEFINE(settings_by_parameter, 1, 1)

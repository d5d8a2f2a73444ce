"""Computes how far the field of an electrode extends beyond its edge: a slab between two electrodes, with air outside.

Finite volumes cover the upper half of the slab and the air above it; the potential of the middle plane is zero. An electrode without fringe
field that is longer by the extension d has the same electrostatic energy in the elastomer. `python3 docs/tools/fringe.py` needs numpy
and scipy.
"""
import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as sl

def grid(inside, n, beyond, growth=1.15):
    """Returns steps of size 1/n over the length `inside`, then growing steps over at least `beyond`."""
    steps = [1 / n] * round(inside * n)
    step, total = 1 / n, 0.0
    while total < beyond:
        step *= growth
        steps.append(step)
        total += step
    return np.array(steps)

def energy(axes, up, permittivity, electrode):
    """Returns twice the energy in the upper half of the slab divided by its permittivity, lengths in h, potential 1 on the electrode.

    axes: widths of volumes along each direction of the plane; up: heights, and the number of heights in the slab; electrode: which volumes
    are below an electrode at the top of the slab."""
    up, slab = up
    eps = np.where(np.arange(len(up)) < slab, permittivity, 1.0)
    shape = [len(a) for a in axes] + [len(up)]
    number = np.arange(np.prod(shape)).reshape(shape)
    rows, cols, vals = [], [], []
    diagonal = np.zeros(np.prod(shape)); rhs = np.zeros(np.prod(shape))
    area = np.ones(shape[:-1])
    for i, a in enumerate(axes):
        area = area * a.reshape([-1 if k == i else 1 for k in range(len(axes))])
    widths = lambda i: axes[i].reshape([-1 if k == i else 1 for k in range(len(shape))])
    couple = []
    for i in range(len(axes)):
        other = (area / axes[i].reshape([-1 if k == i else 1 for k in range(len(axes))]))[..., None] * up * eps
        w = widths(i)
        lo = [slice(None)] * len(shape); hi = list(lo); lo[i] = slice(None, -1); hi[i] = slice(1, None)
        g = other[tuple(lo)] / (0.5 * (w[tuple(slice(None, -1) if k == i else slice(None) for k in range(len(shape)))] + w[tuple(slice(1, None) if k == i else slice(None) for k in range(len(shape)))]))
        couple.append((number[tuple(lo)].ravel(), number[tuple(hi)].ravel(), np.broadcast_to(g, number[tuple(lo)].shape).ravel()))
    for k in range(len(up) - 1):
        g = area / (0.5 * up[k] / eps[k] + 0.5 * up[k + 1] / eps[k + 1])
        if k == slab - 1:
            # Below and above an electrode the potential is 1.
            for layer in (k, k + 1):
                own = area / (0.5 * up[layer] / eps[layer])
                at = number[..., layer][electrode]
                diagonal[at] += own[electrode]; rhs[at] += own[electrode]
            g = np.where(electrode, 0.0, g)
        couple.append((number[..., k].ravel(), number[..., k + 1].ravel(), g.ravel()))
    ground = area * eps[0] / (0.5 * up[0])
    diagonal[number[..., 0].ravel()] += ground.ravel()
    if len(up) == slab:
        own = area / (0.5 * up[-1] / eps[-1])
        at = number[..., -1][electrode]
        diagonal[at] += own[electrode]; rhs[at] += own[electrode]
    for a, b, g in couple:
        rows += [a, b]; cols += [b, a]; vals += [-g, -g]
        np.add.at(diagonal, a, g); np.add.at(diagonal, b, g)
    n = len(diagonal)
    K = sp.csr_matrix((np.concatenate(vals), (np.concatenate(rows), np.concatenate(cols))), (n, n)) + sp.diags(diagonal)
    if len(axes) == 1:
        phi = sl.spsolve(K.tocsc(), rhs)
    else:
        pre = sp.diags(1 / diagonal)
        phi, info = sl.cg(K, rhs, rtol=1e-9, M=pre, maxiter=20000)
        assert info == 0
    # Energy within the slab: half the sum of g (difference)².
    total = 0.0
    inslab = (np.arange(n) % len(up)) < slab
    for a, b, g in couple:
        both = inslab[a] & inslab[b]
        total += (g * (phi[a] - phi[b]) ** 2)[both].sum()
    total += (ground.ravel() * phi[number[..., 0].ravel()] ** 2).sum()
    top = number[..., slab - 1]
    own = area / (0.5 * up[slab - 1] / permittivity)
    total += (own * (1 - phi[top]) ** 2)[electrode].sum()
    if len(up) > slab:
        g = area / (0.5 * up[slab - 1] / permittivity + 0.5 * up[slab])
        flow = g * (phi[top] - phi[number[..., slab]])
        total += (flow ** 2 * 0.5 * up[slab - 1] / permittivity / area)[~electrode].sum()
    return total / permittivity

def heights(n, air):
    slab = np.full(n // 2, 1 / n)
    return (np.concatenate([slab, grid(0.5, n, 20)]) if air else slab), n // 2

def straight(n, permittivity, air):
    left, right = grid(3, n, 6)[::-1], grid(3, n, 20)
    steps = np.concatenate([left, right])
    electrode = np.arange(len(steps)) < len(left)
    # Uniform field: E = 1/(h/2) = 2, energy density 4, over half the thickness: 2 per length.
    return energy([steps], heights(n, air), permittivity, electrode) / 2 - left.sum()

def square(n, side, permittivity, air):
    inside = np.full(round(side / 2 * n), 1 / n)
    steps = np.concatenate([inside, grid(1.5, n, 12)])
    line = np.arange(len(steps)) < len(inside)
    electrode = np.logical_and.outer(line, line)
    area = 4 * energy([steps, steps], heights(n, air), permittivity, electrode) / 2
    return (np.sqrt(area) - side) / 2

def limit(f, sizes):
    """Extrapolates from two grids; the error is proportional to the size of a volume, because the charge density is infinite at the edge."""
    (m, a), (n, b) = [(n, f(n)) for n in sizes]
    return (n * b - m * a) / (n - m)

if __name__ == "__main__":
    print("straight edge, no field outside: %.4f h (ln 2/pi = 0.2206)" % limit(lambda n: straight(n, 1.0, False), (32, 64)))
    for permittivity in (2.8, 4.7, 10.0, 100.0):
        d = limit(lambda n: straight(n, permittivity, True), (32, 64))
        print("straight edge, permittivity %5.1f, air outside: %.4f h" % (permittivity, d))
    for side in (2.0, 4.0, 9.0):
        d = limit(lambda n: square(n, side, 4.7, True), (6, 10))
        bare = limit(lambda n: square(n, side, 1.0, False), (6, 10))
        print("square of side %g h, permittivity 4.7, air outside: %.4f h; no field outside: %.4f h" % (side, d, bare), flush=True)

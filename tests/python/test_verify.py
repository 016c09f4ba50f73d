"""`Transport.verify`: what can be worked out again is, and what is not as it is said is refused."""

import shutil

import deltalux as dl
import forms
import numpy as np
import pytest
from deltalux import FileError, _core
from deltalux.command.cli import main


class Forged:
    """A transport's core that states other norms than it has."""

    def __init__(self, core, kept=1.0, lost=1.0):
        self._core, self._kept, self._lost = core, np.float32(kept), np.float32(lost)

    def __getattr__(self, name):
        return getattr(self._core, name)

    def stated_norms(self):
        kept, lost = self._core.stated_norms()
        return kept * self._kept, lost * self._lost


def path_of(transport):
    return transport._path


def test_what_is_true_is_said_line_by_line(cornell_texels, capsys):
    said = cornell_texels.verify()
    assert [line.split(":")[0] for line in said] == ["files", "texel columns", "audit", "scene", "believed"]
    assert "rows that were traced whole" in said[2] and "digest of the manifest" in said[3]
    assert main(["info", str(path_of(cornell_texels)), "--verify"]) == 0
    assert capsys.readouterr().out.splitlines() == said


@pytest.mark.parametrize(
    ("forged", "said"), [({"kept": 0.9}, "kept of row"), ({"lost": 0.0}, "lost of row")], ids=["kept", "lost"]
)
def test_norms_that_are_none_are_found(cornell_texels, forged, said):
    """Opening believes norms of texel columns, and what rows have lost."""
    transport = dl.Transport(path_of(cornell_texels))
    transport._core = Forged(transport._core, **forged)
    with pytest.raises(FileError, match=said):
        transport.verify()


def test_files_are_read_again(cornell, tmp_path):
    path = tmp_path / "a.transport"
    shutil.copytree(path_of(cornell), path)
    transport = dl.Transport(path)
    assert transport.verify()[1:3] == ["texel columns: none", "audit: none was kept"]
    shard = next(path.glob("tiles-*"))
    shard.write_bytes(shard.read_bytes()[:-1] + b"?")
    with pytest.raises(FileError, match="checksum"):
        transport.verify()
    with pytest.raises(ValueError, match="in memory"):
        dl.Transport(transport._core.__class__.from_dense(np.ones((4, 6)), columns="haar:1")).verify()


@pytest.mark.parametrize("channels", [1, 3])
def test_norms_of_rows_that_two_stages_stand_for(rng, channels):
    """Opening believes them: no entry holds them."""
    P, W = forms.dense(rng, 64, 20), forms.dense(rng, 20, 40, scale=10)
    P = P if channels == 1 else np.stack([P, 2 * P, P / 2], -1)
    first, then = forms.stored(P, "sh:8"), forms.stored(W, "representatives:5x3", width="i8")
    bands = dl.SphericalHarmonics(8).bands
    ones = np.stack([bands == band for band in np.unique(bands)], 1)
    rows, weights = (np.stack([part.row(k) for k in range(part.rows)]).astype(np.float64) for part in (first, then))
    both = np.einsum("rk,kcx->rcx", weights[..., 0], rows)
    true = np.sqrt(np.einsum("rcx,cb->rbx", both**2, ones))
    under = 1 + 2.0**-20

    def found(kept):
        link = _core.Link.representatives([(kept, np.zeros_like(kept))])
        return _core.Transport.join([first], link, [then]).represented(under)

    assert found(true) == (1, None)
    for row, band, channel in [(0, 0, 0), (39, len(ones[0]) - 1, channels - 1)]:
        short = true.copy()
        short[row, band, channel] *= 0.98
        pairs, (which, norm, said) = found(short)
        assert (pairs, which) == (1, row) and norm == pytest.approx(true[row, band, channel]) and said < norm


def test_clusters_are_verified(cornell, tmp_path):
    made = cornell.clustered(tmp_path / "c.transport", clusters=4, representatives=3, progress=False)
    said = made.verify()
    assert "clusters: 565 rows that two stages stand for are no longer than is said" in said, said

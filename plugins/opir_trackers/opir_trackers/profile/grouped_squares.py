"""Sums of the products of rows with themselves, by groups: normal equations of many estimates at once."""

import numpy as np

from opir_core.arrays import FloatArray, IntArray


def squares(told: FloatArray, first: IntArray) -> FloatArray:
    """Return the sums (g, k, k) of the products of rows (m, 2, k) with themselves, of groups that begin at `first`.

    Groups are padded with zeros to the length of the longest of about their length, and multiplied as matrices.
    """
    length = np.diff(np.append(first, len(told)))
    squares = np.empty((len(first), told.shape[2], told.shape[2]))
    for size in np.unique(np.ceil(np.log2(length))).tolist():
        some = np.flatnonzero(np.ceil(np.log2(length)) == size)
        row = np.repeat(np.arange(len(some)), length[some])
        place = np.arange(len(row)) - np.repeat(np.cumsum(length[some]) - length[some], length[some])
        padded = np.zeros((len(some), int(length[some].max()), 2, told.shape[2]))
        padded[row, place] = told[first[some][row] + place]
        flat = padded.reshape(len(some), -1, told.shape[2])
        squares[some] = flat.transpose(0, 2, 1) @ flat
    return squares

"""The campaign of batches in short: every layout, every verdict, bits, memory."""

import subprocess
import sys

import batch_campaign

import graspforce as gf


def test_rows_of_every_layout_are_what_solve_says_whatever_the_threads_and_the_order():
    tally = batch_campaign.Tally()
    for number in range(len(batch_campaign.KINDS)):
        tally.add(number, 400, gf.Settings())
    assert tally.rows == 400 * len(batch_campaign.KINDS)
    assert {"SOLVED", "INFEASIBLE", "WRENCH_UNREACHABLE", "UNBOUNDED", "INVALID_NUMBERS"} <= set(
        tally.statuses
    )
    assert tally.other_status == tally.other_bits == 0
    assert tally.largest <= 1e-9


def test_chunks_of_a_stream_are_solved_in_bounded_memory():
    def peak(rows):
        program = [sys.executable, batch_campaign.__file__, "--memory", "--streamed", str(rows)]
        done = subprocess.run(program, stdout=subprocess.PIPE, check=True, text=True)
        return float(done.stdout.split()[0])

    # Once in a while the allocator places an array of 20 MB beside a hole of that size, whatever
    # the length of the run; memory that is not given back is missing in every run.
    few, many = peak(50_000), min(peak(250_000), peak(250_000))
    assert max(few, many) < 500  # MB
    assert many - few < 30

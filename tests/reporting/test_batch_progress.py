from gmmjax.reporting.batch_progress import batch_progress


def test_a_log_gets_a_line_now_and_then_and_at_the_end(capsys):
    with batch_progress(4) as progress:
        progress.count(done=True, reused=True)
        for done in (True, False, True):
            progress.count(done=done, reused=False)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("gmmjax: 2 of 4 done, 1 from before, ")
    assert lines[1].startswith("gmmjax: 3 of 4 done, 1 from before, 1 failed, ") and lines[1].endswith(", 0 s left")


def test_quiet_is_silent(capsys):
    with batch_progress(1, quiet=True) as progress:
        progress.count(done=True, reused=False)
    assert capsys.readouterr() == ("", "")
    assert progress.counts == "1 of 1 done"

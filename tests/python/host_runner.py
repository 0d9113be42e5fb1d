# SPDX-License-Identifier: Apache-2.0
"""Runs hosts' scripts as `python -m splatboost.cpu` does, each in a separate process with torch already imported.

Importing torch takes longer than training a miniature host. A server imports it once and forks for every script, before
it starts any thread.
"""

import atexit
import json
import os
import subprocess
import sys
import traceback
import types

_server = None


def run(folder, script, *arguments):
    """Runs a script. Returns its returncode, stdout and stderr."""
    global _server
    import conftest

    if _server is None:
        environment = dict(os.environ, PYTHONPATH=str(conftest.PACKAGE), OMP_NUM_THREADS="1")
        _server = subprocess.Popen([sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                   env=environment)
        atexit.register(_server.stdin.close)
    written = [str(folder / (".%s.%s" % (script, name))) for name in ("stdout", "stderr")]
    print(json.dumps([str(folder / script), [*map(str, arguments)], *written]), file=_server.stdin, flush=True)
    code = int(_server.stdout.readline())
    texts = []
    for path in written:
        with open(path, encoding="utf-8") as file:
            texts.append(file.read())
        os.remove(path)
    return types.SimpleNamespace(returncode=code, stdout=texts[0], stderr=texts[1])


def _run_here(script, arguments, out, err):
    for path, stream in ((out, 1), (err, 2)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
    from splatboost import cpu

    try:
        code = cpu.main([script, *arguments])
    except SystemExit as asked:
        code = asked.code if isinstance(asked.code, int) else int(asked.code is not None)
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    atexit._run_exitfuncs()  # os._exit skips them, and temporary folders would remain
    os._exit(code)


def _serve():
    import torch  # noqa: F401

    import splatboost.cpu  # noqa: F401

    answers = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            _run_here(*json.loads(line))
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status) if hasattr(os, "waitstatus_to_exitcode") else status >> 8, file=answers, flush=True)


if __name__ == "__main__":
    _serve()

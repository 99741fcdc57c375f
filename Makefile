# Every target sets up .venv itself; PYTHON names the interpreter to build it from (3.11 or newer).
PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin/python
# no bytecode of files that nothing will import: Python makes it of the others when it first does, if it may keep it;
# where it may not, each of the many processes of the tests takes 5 s to import the packages instead of 2
unexport PYTHONDONTWRITEBYTECODE
PIP := $(RUN) -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt
COMPILED := fasbody/foot/damper.py fasbody/foot/engine.py fasbody/foot/native.py

.PHONY: fit view wheel test test-long environment lint suite docs bench reproduce release clean

fit: $(VENV)/core.stamp  ## fit the bundled synthetic foot; add ARGS="..." for options
	$(RUN) -m identification.fit $(ARGS)

view: $(VENV)/view.stamp  ## the vibrating foot in the browser; add ARGS="..." for options
	$(RUN) -m viz.foot $(ARGS)

wheel: $(VENV)/python.stamp  ## one file for another machine, with models and data inside: dist/*.whl
	$(RUN) -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist .

test:  ## the whole test suite; ARGS="-k name" selects
	$(MAKE) --no-print-directory --jobs=2 environment
	$(MAKE) --no-print-directory --jobs=2 lint suite

test-long: $(VENV)/dev.stamp $(VENV)/compiled.stamp  ## the tests that compute or wait long: whole studies, browsers, other processes
	$(RUN) -m pytest -m long $(ARGS)

environment: $(VENV)/compiled.stamp $(VENV)/dev.stamp  # what the tests need of Python

suite: $(VENV)/collected.stamp  # the lint goes on beside its beginning
	$(RUN) -m pytest $(ARGS)

lint: $(VENV)/dev.stamp
	$(RUN) -m ruff check .
	$(RUN) -m mypy

docs: $(VENV)/dev.stamp  ## the documentation as a site for reading without a network: site/index.html
	$(RUN) -m mkdocs build --strict

bench: $(VENV)/dev.stamp  ## every speed and accuracy ratio the documentation states; ARGS=--full for whole studies
	$(RUN) -m benchmarks $(ARGS)

reproduce: $(VENV)/dev.stamp  ## every equation, table, figure and statement of the thesis -> docs/reproduction.md; goes on where it stopped
	$(RUN) -m reproduction $(ARGS)
	$(RUN) -m pytest -n 0 --quiet reproduction/errata reproduction/load_effect reproduction/arch_validation reproduction/cell

$(VENV)/python.stamp:
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/core.stamp: $(VENV)/python.stamp pyproject.toml constraints.txt
	$(PIP) --editable .
	touch $@

$(VENV)/view.stamp: $(VENV)/python.stamp pyproject.toml constraints.txt
	$(PIP) --editable '.[view]'
	touch $@ $(VENV)/core.stamp

$(VENV)/dev.stamp: $(VENV)/core.stamp pyproject.toml constraints.txt
	$(PIP) --editable '.[dev]'
	touch $@ $(VENV)/view.stamp

# what a fit compiles, while the packages of the tests arrive: each process of the tests would do it by itself
$(VENV)/compiled.stamp: $(VENV)/core.stamp $(COMPILED)
	$(RUN) -m identification.fit --starts 1 --json --out $(VENV)/fit > /dev/null
	touch $@

# bytecode of all that the tests import, beside the lint: each process of the tests would make it by itself
$(VENV)/collected.stamp: $(VENV)/dev.stamp
	$(RUN) -m pytest --collect-only --quiet -n 0 > /dev/null || true  # what is wrong the tests will say
	touch $@

release: $(VENV)/dev.stamp  ## check all that a release needs, and say what a person must do then
	$(RUN) .ci/release

clean:
	rm -rf $(VENV) build dist site .pytest_cache .mypy_cache .ruff_cache

# Two commands do everything: `make demo` plans a sample photo, `make test` runs the whole suite.
# Both make .venv and install into it what is missing; system packages too, where they may.

PYTHON ?= python3
BIN := .venv/bin
DEMO := demo/coffee

.PHONY: demo test lint bench clean

# Without Pycairo there is no PNG; JSON and SVG need nothing of it.
demo: .venv/demo
	@mkdir -p demo
	$(BIN)/strokeplan plan samples/coffee.jpg -o $(DEMO).json -o $(DEMO).svg \
		$$($(BIN)/python -c 'import cairo' 2>/dev/null && echo -o $(DEMO).png)

# Kernels first: processes that test side by side would each compile them.
test: .venv/dev lint
	$(BIN)/python -c 'from strokeplan.planner import warm_up; warm_up()'
	$(BIN)/python -m pytest -n auto

lint: .venv/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: .venv/dev
	$(BIN)/python benchmarks/run.py

.venv/demo: pyproject.toml
	@PYTHON=$(PYTHON) sh .ci/system-packages
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet -e '.[raster]' || { \
		echo "Pycairo could not be built: no PNG for now (the README says what it needs)" >&2; \
		$(BIN)/pip install --quiet -e .; }
	@touch $@

.venv/dev: pyproject.toml
	@PYTHON=$(PYTHON) sh .ci/system-packages test
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet -e '.[dev]'
	$(BIN)/pip install --quiet --no-deps inkex==1.4.1  # without its PyGObject, which only its windows need
	@touch $@ .venv/demo

clean:
	rm -rf .venv demo build dist

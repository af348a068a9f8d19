.PHONY: demo study test fuzz lint types bench clean
VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= python3
READY := $(VENV)/.ready

demo: $(READY) ## train a small monitor, serve the page, and fly a doublet on it
	$(BIN)/forewarn demo

study: $(READY) ## repeat the paper's experiment at a small size and draw its figures
	$(BIN)/forewarn study --n-monitors 4 --n-test 300 --out results/study

test: $(READY) ## every test but the long campaign of damaged files; a file's tests share a process
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile

fuzz: $(READY) ## ten thousand damaged files for the readers, and sixty kills of the server
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m fuzz tests/fuzzing tests/faults

lint: $(READY) ## style, formatting and the direction of imports
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports

types: $(READY) ## static types
	$(BIN)/pyright

bench: $(READY) ## ratios against public peers, each pair in one run
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -m benchmark -s tests/benchmarks

$(READY): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --editable '.[dev]'
	touch $@

clean: ## forget the virtual environment and all results
	rm -rf $(VENV) results

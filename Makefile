.PHONY: demo study studies test fuzz services lint types types-page bench command-line pictures wheelhouse clean
VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= python3
# two stamps: what the program needs is there; what its tests need is there too
RUNS := $(VENV)/.runs
READY := $(VENV)/.ready
# a process uses one core; what each imports is compiled once
TESTING := OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=
# pip compiles every module, tests included, on one core: compiling without those on all is faster
INSTALL := $(BIN)/pip install --quiet --disable-pip-version-check --no-compile --editable
COMPILE := $(BIN)/python -m compileall -qq -j 0 -x '/tests?/' $(VENV)/lib || true # some cannot be
# more arguments of pytest or of the demo, such as ALSO='--last-failed -n 0' and ALSO='--port 8001'
ALSO :=
ENOUGH := $(if $(wildcard $(READY)),$(READY),$(RUNS))

demo: $(ENOUGH) ## train a small monitor, serve the page, and fly a doublet on it
	$(BIN)/forewarn demo $(ALSO)

study: $(ENOUGH) ## repeat the paper's experiment at a small size and draw its figures
	$(BIN)/forewarn study --n-monitors 4 --n-test 300 --out results/study

studies: $(READY) ## the tables of the guide: campaigns, clearances, near and far aircraft, faults
	mkdir -p results/studies
	for study in fault_table validity_matrix near_foreign clearance_errors campaign_study campaign_ceiling roll_ceiling; do \
	    $(BIN)/python -m tests.studies.$$study -o results/studies/$$study.csv || exit 1; done

test: $(READY) ## every test but the long campaign of damaged files; a file's tests share a process
	$(TESTING) $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder --ignore tests/benchmarks $(ALSO)

fuzz: $(READY) ## what repeats facts at length: ten thousand damaged files, calls of every route, a hundred and ten kills of the server, laws at every case
	FOREWARN_CAMPAIGN=1 $(TESTING) $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder -m "fuzz or (hypothesis and not benchmark)" $(ALSO)

services: $(READY) ## the tests that need PostgreSQL (initdb on the path), Dask, mosquitto, Prometheus or Open MCT (npm); they start and stop it
	$(TESTING) $(BIN)/python -m pytest -n 0 -m "services and not benchmark" $(ALSO)

lint: $(READY) ## style, formatting and the direction of imports
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports
	$(BIN)/python -m tests.support.rooms

types: $(READY) ## static types
	$(BIN)/pyright

types-page: ## types of the page's modules, by TypeScript from the npm registry
	npx --yes --package typescript@7 tsc --project static/jsconfig.json

bench: $(READY) ## ratios against public peers, each pair in one run
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -m benchmark -s tests/benchmarks

command-line: $(READY) ## write the guide's page on the command line from the parser
	$(BIN)/python -m tests.support.command_line_page

pictures: $(READY) ## take the guide's pictures of the pages in Chromium, and draw its figures
	$(BIN)/python -m tests.support.guide_pictures

wheelhouse: ## all that an installation without a network needs, in the folder wheelhouse
	rm -rf wheelhouse && mkdir wheelhouse
	$(PYTHON) -m pip wheel --quiet --no-deps --wheel-dir wheelhouse .
	$(PYTHON) -m pip download --quiet --only-binary :all: --dest wheelhouse --find-links wheelhouse \
	    'forewarn[ulog,mdf,tdms,mcap,fmu,jsbsim,postgres,dask,mqtt] @ file://$(CURDIR)/'wheelhouse/$$(cd wheelhouse && ls forewarn-*.whl)
	cp app/upkeep/offline.py wheelhouse/install.py

$(RUNS): pyproject.toml
	@echo "Making $(VENV) with what the program needs: about 0.9 GB and 2.5 minutes."
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) .
	$(COMPILE)
	@touch $@

$(READY): pyproject.toml
	@echo "Adding to $(VENV) what the tests need too: about 0.7 GB more."
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) '.[dev]'
	$(COMPILE)
	@touch $(RUNS) $@

clean: ## forget the virtual environment and all results
	rm -rf $(VENV) results wheelhouse

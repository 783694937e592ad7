# Two targets do everything on a fresh machine: `make reproduce` and `make test`.
PYTHON ?= python3
VENV := .venv
PIP := $(VENV)/bin/python -m pip install --quiet --disable-pip-version-check -c requirements.lock
NATIVE := pyproject.toml CMakeLists.txt requirements.lock $(shell find cpp -name '*.hpp' -o -name '*.cpp')

.PHONY: reproduce test docs picture matrix matrix-short lint wheels bench instructions campaign batch-campaign decrements derivatives fuzz soak soak-page portable clean
CPP := $(shell find cpp benchmarks examples -name '*.hpp' -o -name '*.cpp' -o -name '*.[ch]')

reproduce: $(VENV)/sim.installed  ## Section IV of the paper, also in physics, into results/
	$(VENV)/bin/python -m graspforce reproduce --out results

test: $(VENV)/test.installed  ## all tests
	OPENBLAS_NUM_THREADS=1 $(VENV)/bin/python -m pytest -n auto --maxprocesses 8 --dist loadfile --no-loadscope-reorder

docs: $(VENV)/dev.installed  ## the site, into build/site, without a network
	$(VENV)/bin/codespell *.md docs examples/gallery
	$(VENV)/bin/sphinx-build --quiet -a -W --keep-going -j auto -d build/doctrees docs build/site
	$(VENV)/bin/python -m pytest -q -p no:cacheprovider tests/built_site.py

picture: $(VENV)/dev.installed  ## the README's moving picture, docs/images/regrasp.webp
	$(VENV)/bin/python docs/figures/film.py

matrix: $(VENV)/dev.installed  ## the tests under other processors, versions and habits, about an hour
	$(VENV)/bin/python tests/matrix.py

matrix-short: $(VENV)/test.installed  ## the numeric tests as older processors compute them
	$(VENV)/bin/python tests/matrix.py --short

lint: $(VENV)/dev.installed  ## formatters, linters, type checker, import order, stubs
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/basedpyright
	$(VENV)/bin/lint-imports
	$(VENV)/bin/clang-format --dry-run --Werror $(CPP)
	$(VENV)/bin/python -m nanobind.stubgen -q -m graspforce._core -O build
	diff src/graspforce/_core.pyi build/_core.pyi

wheels: $(VENV)/dev.installed  ## for this machine's Pythons on old Linux, into dist/, and proof that they run
	$(VENV)/bin/python tests/wheels.py

bench: $(VENV)/test.installed  ## time this machine
	$(VENV)/bin/python -m graspforce bench

instructions: $(VENV)/test.installed  ## what a tick of the core may take, counted by Valgrind
	$(VENV)/bin/python benchmarks/instructions.py --gate

campaign: $(VENV)/test.installed  ## a million random grasps against another solver, some 30 minutes
	rm -f build/campaign.txt && mkdir -p build
	$(VENV)/bin/python benchmarks/campaign.py --grasps 1000000 --save build/campaign.txt
	$(VENV)/bin/python benchmarks/campaign.py --grasps 50000 --margin 1e-4 --save build/campaign.txt
	$(VENV)/bin/python benchmarks/campaign.py --grasps 50000 --margin 1e-5 --save build/campaign.txt
	mv build/campaign.txt benchmarks/results/campaign.txt

batch-campaign: $(VENV)/test.installed  ## a million rows of solve_batch against solve, some 15 minutes
	OPENBLAS_NUM_THREADS=1 $(VENV)/bin/python benchmarks/batch_campaign.py --save benchmarks/results/batch_campaign.txt

decrements: $(VENV)/test.installed  ## the certified bounds of a hundred thousand ticks against NumPy, minutes
	OPENBLAS_NUM_THREADS=1 $(VENV)/bin/python benchmarks/decrements.py --ticks 100000 --save benchmarks/results/decrements.txt

GRASPS := $(wildcard ../shared/data/allegro_ycb.npz)
derivatives: $(VENV)/test.installed  ## those by every field against exact ones and differences, half an hour
	OPENBLAS_NUM_THREADS=1 $(VENV)/bin/python benchmarks/derivatives.py --tol 1e-24 1e-9 \
	  $(GRASPS:%=--grasps %) --save benchmarks/results/derivatives.txt

# The core alone needs no Python. Programs go to build/; SECONDS and TICKS may be given.
SECONDS := 600
TICKS := 10000000
CORE := -std=c++17 -fno-math-errno -fno-trapping-math -Wall -Wextra -Wno-psabi -Icpp/include -Icpp/tests
WIDE := $(shell grep -q avx2 /proc/cpuinfo 2>/dev/null && echo -mavx2 -mfma)

fuzz:  ## extreme numbers, with Clang's libFuzzer; what it finds goes to build/
	mkdir -p build/corpus
	clang++ $(CORE) -O2 -g -DFUZZER -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=undefined \
	  cpp/tests/fuzz.cpp -o build/fuzz
	build/fuzz -max_len=512 -max_total_time=$(SECONDS) -artifact_prefix=build/ build/corpus

soak:  ## ten million servo ticks of all kinds, some minutes
	mkdir -p build
	$(CXX) $(CORE) -O3 $(WIDE) benchmarks/soak.cpp -o build/soak
	build/soak $(TICKS)

soak-page: $(VENV)/test.installed  ## the live page: 20,000 turns of knobs in a browser, some minutes
	$(VENV)/bin/python benchmarks/viewer.py --save benchmarks/results/viewer.txt

# The core's tests by every compiler that is here, for every instruction set.
portable:
	cpp/tests/portable.sh $(CORE)

# An editable install: Python changes need nothing, a change of the core builds it again. Each set
# of extras contains those before it.
$(VENV)/sim.installed: INSTALLED = sim
$(VENV)/test.installed: INSTALLED = sim test
$(VENV)/dev.installed: INSTALLED = sim test dev
$(VENV)/%.installed: $(NATIVE)
	test -x $(VENV)/bin/python || $(PYTHON) -m venv $(VENV)
	$(PIP) -e '.[$*]'
	touch $(INSTALLED:%=$(VENV)/%.installed)

clean:
	rm -rf $(VENV) build dist results docs/gallery docs/sg_execution_times.rst

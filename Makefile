# Everything runs in .venv, which is made on first use; only Python 3.11 or newer is needed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test check bench test-slow soak clean

demo: $(VENV)/.demo
	$(BIN)/ibfctl demo --out demo-results

test: $(VENV)/.test
	$(BIN)/python -m pytest -n 2 --dist loadfile # most of their time they wait for sockets and clocks

test-slow: $(VENV)/.test
	$(BIN)/python -m pytest -m slow

soak: $(VENV)/.test
	$(BIN)/python -m benchmarks all soak

check: $(VENV)/.dev
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(VENV)/.test
	$(BIN)/python -m benchmarks all

clean:
	rm -rf $(VENV) demo-results benchmarks/out

$(BIN)/python:
	$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); echo "error: no venv with pip; on Debian: apt install python3-venv" >&2; exit 1; }

# One stamp per set of extras, renewed when pyproject.toml changes.
$(VENV)/.demo: EXTRA := plots,progress
$(VENV)/.test: EXTRA := test
$(VENV)/.dev: EXTRA := dev
$(VENV)/.demo $(VENV)/.test $(VENV)/.dev: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[$(EXTRA)]'
	touch $@

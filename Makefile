# The everyday commands; each is one line that can be typed as well.
PLUGINS = $(wildcard ./plugins/*/)

.PHONY: install test quick lint types format ci benchmarks

install:
	python -m pip install -e ".[test,lint]" $(addprefix -e ,$(PLUGINS))

test:
	python -m pytest

quick:
	python -m pytest -m "not slow" -x -q

lint:
	python -m ruff check . && python -m ruff format --check .

format:
	python -m ruff check --fix . && python -m ruff format .

types:
	python -m mypy

ci:
	bash .ci/run

benchmarks:
	python benchmarks/throughput.py && python benchmarks/startup.py

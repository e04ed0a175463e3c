# Everyday commands, one line each.
PLUGINS = $(wildcard ./plugins/*/)

.PHONY: install test all explore kafka lint types format ci site mutants benchmarks

install:
	python -m pip install -e ".[test,peers,lint,docs]" $(addprefix -e ,$(PLUGINS))

test:
	python -m pytest

all:
	python -m pytest -m "" --hypothesis-profile=full

explore:
	python -m pytest -m hypothesis --hypothesis-profile=explore

kafka:
	python -m pytest -m "" tests/journeys/test_real_kafka.py tests/journeys/test_real_kafka_tls.py tests/journeys/test_real_registry.py

lint:
	python -m ruff check . && python -m ruff format --check .

format:
	python -m ruff check --fix . && python -m ruff format .

types:
	python -m mypy

site:
	python -m sphinx -W --keep-going --quiet -b html docs build/site

ci:
	OPIR_THIRD=all bash .ci/run

mutants:
	python tests/mutation/sample.py

benchmarks:
	python -m benchmarks --json benchmarks.json

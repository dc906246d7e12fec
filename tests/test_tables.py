"""Schemas: declared once, complete, and the same words everywhere."""

from __future__ import annotations

import json

import pyarrow as pa
import pytest

from ecat.tables import PUBLISHED, TABLES, TableSchema

SCHEMAS = [pytest.param(schema, id=name) for name, schema in TABLES.items()]


@pytest.mark.parametrize("schema", SCHEMAS)
class TestEverySchema:
    def test_every_column_says_what_it_means(self, schema: TableSchema) -> None:
        assert schema.meaning
        assert all(column.meaning for column in schema.columns)
        assert len({column.name for column in schema.columns}) == len(schema.columns)

    def test_arrow_fields_carry_meaning_unit_and_reference(self, schema: TableSchema) -> None:
        for column in schema.columns:
            field = schema.arrow.field(column.name)
            metadata = field.metadata
            assert metadata is not None
            assert (field.type, field.nullable) == (column.type, column.nullable)
            assert metadata[b"unit"].decode() == column.unit

    def test_rows_are_sorted_by_columns_that_exist(self, schema: TableSchema) -> None:
        assert set(schema.order) <= {column.name for column in schema.columns}

    def test_names_carry_the_unit_where_it_is_not_si(self, schema: TableSchema) -> None:
        for column in schema.columns:
            if column.unit in {"px", "ns"}:
                assert column.name.endswith(f"_{column.unit}")

    def test_angles_and_lengths_are_floats_and_missing_is_null(self, schema: TableSchema) -> None:
        for column in schema.columns:
            if column.unit in {"m", "px", "rad"}:
                one = column.type.value_type if pa.types.is_fixed_size_list(column.type) else column.type
                assert pa.types.is_float64(one)
                assert column.nullable

    def test_it_is_json(self, schema: TableSchema) -> None:
        assert json.loads(json.dumps(schema.to_dict()))["name"] == schema.name


def test_published_tables_name_their_layer() -> None:
    assert all(schema.columns[0].name == "layer" for schema in PUBLISHED)

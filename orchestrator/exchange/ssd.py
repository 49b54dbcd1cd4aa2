"""``SystemStructure.ssd`` (SSP 1.0): records to XML and back.

Start values are written twice, inline and as a named parameter set (``.ssv``): of the masters at
hand one reads the former only, another the latter. What SSP has no word for stands as JSON in
annotations of type ``hedgehop``; the step sizes also in the form that libcosim and Ecos read.
"""

import json
from collections.abc import Iterable, Mapping
from typing import Any, cast

import lxml.etree

from orchestrator.assembly.units import BASES, Unit
from orchestrator.exchange.structure import (
    Connection,
    Connector,
    Element,
    Kind,
    Parameter,
    Structure,
    Type,
)

etree: Any = lxml.etree  # has no types

_SSP = "http://ssp-standard.org/SSP1/"
NAMESPACES = {
    "ssd": _SSP + "SystemStructureDescription",
    "ssc": _SSP + "SystemStructureCommon",
    "ssv": _SSP + "SystemStructureParameterValues",
}
OSP, OSP_URI = "com.opensimulationplatform", "https://opensimulationplatform.com/SSP/OSPAnnotations"
OURS = "hedgehop"
OUR_URI = "urn:hedgehop:scenario"
FMU = "application/x-fmu-sharedlibrary"
TYPES: tuple[Type, ...] = ("Real", "Integer", "Boolean", "String", "Enumeration")

_PARSERS: dict[str, Any] = {
    "Real": float,
    "Integer": int,
    "Boolean": ("true", "1").__contains__,
    "String": str,
    "Enumeration": str,
}


def write(structure: Structure) -> dict[str, bytes]:
    """Return the files of an archive that describe a structure, by path."""
    # prefixes stand at the root alone: libcosim takes a declaration for a child element
    prefixes = {**NAMESPACES, "osp": OSP_URI, OURS: OUR_URI}
    root = etree.Element(_tag("ssd:SystemStructureDescription"), nsmap=prefixes)
    root.attrib.update({"name": structure.name, "version": "1.0", "generationTool": "hedgehop"})
    system = _add(root, "ssd:System", name="system")
    elements = _add(system, "ssd:Elements")
    files: dict[str, bytes] = {}
    for element in structure.elements:
        _write_element(elements, element)
        if element.parameters:
            values = etree.Element(_tag("ssv:ParameterSet"), nsmap=NAMESPACES)
            _write_parameters(values, element)
            files[_parameter_file(element)] = _bytes(values)
    if structure.connections:
        connections = _add(system, "ssd:Connections")
        for connection in structure.connections:
            _write_connection(connections, connection)
    if structure.units:
        units = _add(root, "ssd:Units")
        for unit in structure.units:
            _write_unit(units, unit)
    experiment = _add(root, "ssd:DefaultExperiment", startTime=repr(structure.start_s))
    if structure.stop_s is not None:
        experiment.set("stopTime", repr(structure.stop_s))
    if structure.step_s is not None:
        note = _annotation(_add(experiment, "ssd:Annotations"), OSP)
        algorithm = etree.SubElement(note, f"{{{OSP_URI}}}Algorithm")
        step = etree.SubElement(algorithm, f"{{{OSP_URI}}}FixedStepAlgorithm")
        step.set("baseStepSize", repr(structure.step_s))
    if structure.notes:
        _note(_add(root, "ssd:Annotations"), structure.notes)
    return {"SystemStructure.ssd": _bytes(root), **files}


def read(files: Mapping[str, bytes]) -> Structure:
    """Return the structure that the files of an archive describe.

    Raises
    ------
    ValueError
        If it is not valid by the schema, or has what is not supported, which is named.
    """
    if "SystemStructure.ssd" not in files:
        raise ValueError("no SystemStructure.ssd, expected one in the archive")
    root = _parsed(files["SystemStructure.ssd"], "SystemStructure.ssd", "Description")
    system = _one(root, "ssd:System")
    _refuse(system)
    experiment = root.find("ssd:DefaultExperiment", NAMESPACES)
    stop = None if experiment is None else experiment.get("stopTime")
    osp = root.find(f"ssd:DefaultExperiment//{{{OSP_URI}}}FixedStepAlgorithm", NAMESPACES)
    units = root.findall("ssd:Units/ssc:Unit", NAMESPACES)
    return Structure(
        name=root.get("name", ""),
        elements=tuple(
            _read_element(each, files)
            for each in system.findall("ssd:Elements/ssd:Component", NAMESPACES)
        ),
        connections=tuple(
            _read_connection(each)
            for each in system.findall("ssd:Connections/ssd:Connection", NAMESPACES)
        ),
        units=tuple(_read_unit(each) for each in units),
        start_s=0.0 if experiment is None else float(experiment.get("startTime", "0")),
        stop_s=None if stop is None else float(stop),
        step_s=None if osp is None else float(osp.get("baseStepSize", "nan")),
        notes=_read_note(root),
    )


def _write_element(parent: Any, element: Element) -> None:
    component = _add(parent, "ssd:Component", name=element.name, type=FMU, source=element.source)
    component.set("implementation", "CoSimulation")
    if element.connectors:
        connectors = _add(component, "ssd:Connectors")
        for each in element.connectors:
            connector = _add(connectors, "ssd:Connector", name=each.name, kind=each.kind)
            kind = _add(connector, f"ssc:{each.type}")
            if each.unit and each.type == "Real":
                kind.set("unit", each.unit)
    if element.parameters:
        bindings = _add(component, "ssd:ParameterBindings")
        inline = _add(_add(bindings, "ssd:ParameterBinding"), "ssd:ParameterValues")
        _write_parameters(_add(inline, "ssv:ParameterSet"), element)
        _add(bindings, "ssd:ParameterBinding", source=_parameter_file(element))
    notes = _add(component, "ssd:Annotations")
    if element.step_s is not None:
        hint = etree.SubElement(_annotation(notes, OSP), f"{{{OSP_URI}}}StepSizeHint")
        hint.set("value", repr(element.step_s))
    _note(notes, element.notes)


def _write_parameters(root: Any, element: Element) -> None:
    root.attrib.update({"version": "1.0", "name": element.name})
    parameters = _add(root, "ssv:Parameters")
    for each in element.parameters:
        value = str(each.value).lower() if isinstance(each.value, bool) else str(each.value)
        _add(_add(parameters, "ssv:Parameter", name=each.name), f"ssv:{each.type}", value=value)


def _parameter_file(element: Element) -> str:
    return f"resources/{element.name}.ssv"


def _write_connection(parent: Any, connection: Connection) -> None:
    (start, source), (end, target) = connection.start, connection.end
    made = _add(parent, "ssd:Connection", startElement=start, startConnector=source)
    made.attrib.update({"endElement": end, "endConnector": target})
    if (connection.factor, connection.offset) != (1.0, 0.0):
        made.set("suppressUnitConversion", "true")  # the transformation is the conversion
        factor, offset = repr(connection.factor), repr(connection.offset)
        _add(made, "ssc:LinearTransformation", factor=factor, offset=offset)
    if connection.notes:
        _note(_add(made, "ssd:Annotations"), connection.notes)


def _write_unit(parent: Any, unit: Unit) -> None:
    base = _add(_add(parent, "ssc:Unit", name=unit.name), "ssc:BaseUnit")
    for symbol, exponent in zip(BASES, unit.dimension or (0,) * len(BASES), strict=True):
        if exponent:
            base.set(symbol, str(exponent))
    if unit.factor != 1.0:
        base.set("factor", repr(unit.factor))
    if unit.offset:
        base.set("offset", repr(unit.offset))


def _refuse(system: Any) -> None:
    """Raise for the first thing that a scenario cannot say."""
    for path, what in (
        ("ssd:Elements/ssd:System", "a system within the system"),
        ("ssd:Elements/ssd:SignalDictionaryReference", "a signal dictionary"),
        ("ssd:ParameterBindings", "parameters of the system as a whole"),
        ("ssd:Connections/ssd:Connection/ssc:BooleanMappingTransformation", "a mapping of values"),
        ("ssd:Connections/ssd:Connection/ssc:IntegerMappingTransformation", "a mapping of values"),
        (
            "ssd:Connections/ssd:Connection/ssc:EnumerationMappingTransformation",
            "a mapping of values",
        ),
        ("ssd:Elements/ssd:Component//ssd:ParameterMapping", "a mapping of parameters"),
    ):
        found = system.find(path, NAMESPACES)
        if found is not None:
            name = found.get("name") or found.getparent().get("name") or ""
            raise ValueError(
                f"SystemStructure.ssd:{found.sourceline}: {what} is not supported, got "
                f"{etree.QName(found).localname} {name}".rstrip()
            )


def _read_element(component: Any, files: Mapping[str, bytes]) -> Element:
    name = component.get("name")
    where = f"SystemStructure.ssd:{component.sourceline}: component {name!r}"
    if component.get("type", FMU) != FMU:
        raise ValueError(f"{where}: not an FMU, got {component.get('type')!r}, expected {FMU!r}")
    if component.get("implementation", "any") not in ("any", "CoSimulation"):
        raise ValueError(f"{where}: not for co-simulation, got {component.get('implementation')!r}")
    parameters: dict[str, Parameter] = {}
    for binding in component.findall("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES):
        if binding.get("prefix"):
            what = f"got prefix {binding.get('prefix')!r}"
            raise ValueError(f"{where}: a prefix of parameters is not supported, {what}")
        for each in _read_binding(binding, files, where):
            parameters[each.name] = each
    hint = component.find(f".//{{{OSP_URI}}}StepSizeHint")
    return Element(
        name=name,
        source=component.get("source"),
        connectors=tuple(
            _read_connector(each)
            for each in component.findall("ssd:Connectors/ssd:Connector", NAMESPACES)
        ),
        parameters=tuple(parameters.values()),
        notes=_read_note(component),
        step_s=None if hint is None else float(hint.get("value")),
    )


def _read_binding(binding: Any, files: Mapping[str, bytes], where: str) -> Iterable[Parameter]:
    """Return the parameters of a binding: inline, or in a file of the archive."""
    source = binding.get("source")
    if source is None:
        sets = binding.findall("ssd:ParameterValues/ssv:ParameterSet", NAMESPACES)
    elif source in files:
        sets = [_parsed(files[source], source, "ParameterValues")]
    else:
        raise ValueError(f"{where}: no such parameter file in the archive, got {source!r}")
    for values in sets:
        for each in values.findall("ssv:Parameters/ssv:Parameter", NAMESPACES):
            (value,) = (child for child in each if etree.QName(child).localname != "Annotations")
            kind = etree.QName(value).localname
            if kind not in TYPES:
                raise ValueError(f"{where}: parameter {each.get('name')!r} is of type {kind}")
            yield Parameter(each.get("name"), kind, _PARSERS[kind](value.get("value")))


def _read_connector(connector: Any) -> Connector:
    (kind,) = [
        child
        for child in connector
        if etree.QName(child).localname in TYPES and child.tag.startswith(f"{{{NAMESPACES['ssc']}")
    ] or [None]
    name = connector.get("name")
    if kind is None:
        raise ValueError(
            f"SystemStructure.ssd:{connector.sourceline}: connector {name!r} has no type that is "
            f"supported, expected one of {', '.join(TYPES)}"
        )
    return Connector(
        name,
        cast(Kind, connector.get("kind")),
        cast(Type, etree.QName(kind).localname),
        kind.get("unit", ""),
    )


def _read_connection(connection: Any) -> Connection:
    start, end = connection.get("startElement"), connection.get("endElement")
    if start is None or end is None:
        raise ValueError(
            f"SystemStructure.ssd:{connection.sourceline}: a connector of the system as a whole is "
            f"not supported, got {connection.get('startConnector')!r} -> "
            f"{connection.get('endConnector')!r}"
        )
    linear = connection.find("ssc:LinearTransformation", NAMESPACES)
    return Connection(
        (start, connection.get("startConnector")),
        (end, connection.get("endConnector")),
        1.0 if linear is None else float(linear.get("factor", "1")),
        0.0 if linear is None else float(linear.get("offset", "0")),
        {**_read_note(connection), "is_final": connection.get("suppressUnitConversion") == "true"},
    )


def _read_unit(unit: Any) -> Unit:
    base = _one(unit, "ssc:BaseUnit")
    dimension = tuple(int(base.get(symbol, "0")) for symbol in BASES)
    factor, offset = float(base.get("factor", "1")), float(base.get("offset", "0"))
    return Unit(unit.get("name"), dimension, factor, offset)


def _parsed(data: bytes, name: str, schema: str) -> Any:
    """Return the root of an XML file that is valid by its schema."""
    from fmpy.ssp.ssd import validate_tree

    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise ValueError(f"{name}: not XML, {error.msg}") from error
    if root.get("version") != "1.0":
        raise ValueError(f"{name}: SSP {root.get('version')}, expected 1.0")
    file = f"SystemStructure{schema}.xsd"
    try:
        validate_tree(root, file)
    except Exception as error:
        first = str(error).partition("\n")[2].partition("\n")[0]
        raise ValueError(f"{name}: not valid by {file}, {first}") from error
    return root


def _tag(name: str) -> str:
    prefix, _, local = name.partition(":")
    return f"{{{NAMESPACES[prefix]}}}{local}"


def _add(parent: Any, tag: str, /, **attributes: str) -> Any:
    return etree.SubElement(parent, _tag(tag), attributes)


def _one(parent: Any, path: str) -> Any:
    found = parent.find(path, NAMESPACES)
    if found is None:
        raise ValueError(f"SystemStructure.ssd:{parent.sourceline}: no {path.partition(':')[2]}")
    return found


def _annotation(parent: Any, kind: str) -> Any:
    return _add(parent, "ssc:Annotation", type=kind)


def _note(annotations: Any, notes: Mapping[str, Any]) -> None:
    """Write plain data as an annotation of our own."""
    note = etree.SubElement(_annotation(annotations, OURS), f"{{{OUR_URI}}}Scenario")
    note.text = json.dumps(notes, sort_keys=True)


def _read_note(parent: Any) -> dict[str, Any]:
    path = f"ssd:Annotations/ssc:Annotation/{{{OUR_URI}}}Scenario"
    note = parent.find(path, NAMESPACES)
    return {} if note is None else json.loads(note.text)


def _bytes(root: Any) -> bytes:
    etree.indent(root)
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8")

"""modelDescription.xml and the C structure of a model, FMI 2 and FMI 3, from one table."""

import itertools
import math
import re
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from fmus.models import INTERVAL, PHASES, UNITS, Model, Variable

C_TYPES = {"Float64": "double", "Float32": "float", "Boolean": "bool", "String": "Text",
           "Binary": "Bytes", "Enumeration": "int64_t", "Clock": "bool"}  # fmt: skip
FRONT_END = ("WITHOUT_STEP", "MINIMAL", "ONCE")  # what is not the model's own
FMI2_TYPES = {"Float64": "Real", "Int32": "Integer"}
TIME = Variable("time", "independent")


@dataclass(frozen=True)
class Entry:
    """What one value reference stands for: a variable, or in FMI 2 one element of it."""

    name: str
    variable: Variable
    first: int
    count: int


def token(name: str, fmi: int) -> str:
    """Return the GUID that XML and binary agree on."""
    return f"{{{name}-{fmi}}}"


def entries(model: Model, fmi: int) -> list[Entry]:
    """Return the entries by value reference; FMI 2 has no arrays."""
    made = []
    for variable in (TIME, *model.variables):
        if variable.causality == "hidden":
            continue
        if fmi == 3 or not variable.shape:
            made.append(Entry(variable.name, variable, 0, math.prod(variable.shape)))
            continue
        indices = itertools.product(*(range(1, n + 1) for n in variable.shape))
        for k, index in enumerate(indices):
            made.append(Entry(f"{variable.name}[{','.join(map(str, index))}]", variable, k, 1))
    return made


def header(name: str, model: Model, fmi: int) -> str:
    """Return variables.h."""
    rows = (TIME, *model.variables)
    members = [
        f"    {C_TYPES.get(v.type, v.type.lower() + '_t')} {_c(v.name)}"
        + (f"[{math.prod(v.shape)}]" if v.shape else "") + ";"
        for v in rows
    ]  # fmt: skip
    table = [
        f"    {{{_c_type(e.variable)}, {_settable(e.variable)}, offsetof(Values, {_c(e.variable.name)})"
        f" + {e.first} * sizeof({C_TYPES.get(e.variable.type, e.variable.type.lower() + '_t')}),"
        f" {e.count}}},"
        for e in entries(model, fmi)
    ]
    starts = [f"    .{_c(v.name)} = {_c_start(v)}," for v in rows if v.start is not None]
    references = [f"VR_{_c(e.name)} = {i}" for i, e in enumerate(entries(model, fmi))]
    lines = [
        "#include <stddef.h>",
        f'#define TOKEN "{token(name, fmi)}"',
        f"#define INTERVAL {INTERVAL}",
        f"#define IS_FMI2 {int(fmi == 2)}",
        *(f"#define {key} {model.defines[key]}" for key in FRONT_END if key in model.defines),
        "typedef struct {", *members, "} Values;",
        "static const Variable VARIABLES[] = {", *table, "};",
        "static const Values START = {", *starts, "};",
        f"enum {{ {', '.join(references)} }};",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def xml(name: str, model: Model, fmi: int) -> str:
    """Return modelDescription.xml."""
    return (_xml2 if fmi == 2 else _xml3)(name, model)


def _c(name: str) -> str:
    return re.sub(r"\W", "_", name)


def _c_type(v: Variable) -> str:
    return "INT64" if v.type == "Enumeration" else v.type.upper()


def _c_start(v: Variable) -> str:
    one = {"String": f'"{v.start}"', "Binary": "{2, {0x00, 0xff}}"}.get(
        v.type, str(int(v.start) if isinstance(v.start, bool) else v.start)
    )
    return f"{{{', '.join([one] * math.prod(v.shape))}}}" if v.shape else one


def _settable(v: Variable) -> str:
    if v.causality == "input" or "tunable" in v.variability:
        return "TUNABLE"
    return "AT_START" if v.start is not None else "NEVER"


def _attributes(**given: object) -> str:
    """Return XML attributes of what is given; None is left out."""
    return "".join(
        f" {key}={quoteattr(str(value).lower() if isinstance(value, bool) else str(value))}"
        for key, value in given.items()
        if value is not None
    )


def _common(v: Variable) -> dict[str, object]:
    """Return causality, variability and initial."""
    if v.causality == "independent":
        return {"causality": "independent", "variability": "continuous"}
    natural = "continuous" if v.type in ("Float64", "Float32") else "discrete"
    variability = natural if "state" in v.variability else v.variability or natural
    initial = None if v.causality == "input" else v.initial
    return {"causality": v.causality, "variability": variability, "initial": initial}


def _once(model: Model) -> dict[str, bool]:
    return {"canBeInstantiatedOnlyOncePerProcess": True} if "ONCE" in model.defines else {}


def _structure(model: Model, fmi: int) -> dict[str, list[tuple[int, list[int]]]]:
    """Return references and dependencies of outputs, derivatives and initial unknowns."""
    table = entries(model, fmi)
    by_name: dict[str, list[int]] = {}
    for reference, entry in enumerate(table):
        by_name.setdefault(entry.variable.name, []).append(reference)

    def rows(wanted, knowns=None):
        made = []
        for reference, entry in enumerate(table):
            if not wanted(entry.variable):
                continue
            depends = []
            for name in entry.variable.depends:
                if knowns is None or name in knowns:
                    others = by_name[name]
                    depends += others if len(others) == 1 else [others[entry.first]]
            made.append((reference, sorted(depends)))
        return made

    knowns = {v.name for v in model.variables if v.causality == "input"} | {"x"}
    return {
        "outputs": rows(lambda v: v.causality == "output", knowns),
        "derivatives": rows(lambda v: v.derivative_of, knowns),
        "initial": rows(lambda v: (v.causality == "output" and v.start is None) or v.derivative_of),
    }


def _units() -> str:
    return "".join(f"<Unit name='{name}'><BaseUnit {base}/></Unit>" for name, base in UNITS.items())


def _xml2(name: str, model: Model) -> str:
    table = entries(model, 2)
    numbers = {e.name: i for i, e in enumerate(table)}  # from 1: time is not in the list
    variables = []
    for reference, entry in enumerate(table[1:], start=1):
        v = entry.variable
        derivative = numbers[v.derivative_of] if v.derivative_of else None
        start = str(v.start).lower() if isinstance(v.start, bool) else v.start
        inner = _attributes(
            declaredType="Phase" if v.type == "Enumeration" else None,
            unit=v.unit or None, min=v.min, max=v.max, start=start, derivative=derivative,
        )  # fmt: skip
        outer = _attributes(name=entry.name, valueReference=reference, **_common(v))
        kind = FMI2_TYPES.get(v.type, v.type)
        variables.append(f"<ScalarVariable{outer}><{kind}{inner}/></ScalarVariable>")
    names = {
        "canGetAndSetFMUState": "canGetAndSetFMUstate",
        "canSerializeFMUState": "canSerializeFMUstate",
        "providesDirectionalDerivatives": "providesDirectionalDerivative",
        "canHandleVariableCommunicationStepSize": "canHandleVariableCommunicationStepSize",
    }
    flags = {names[k]: value for k, value in model.capabilities.items() if k in names}
    flags |= _once(model)
    experiment = model.experiment
    if "fixedInternalStepSize" in model.capabilities:  # FMI 2 has no word for it
        experiment += f" stepSize='{model.capabilities['fixedInternalStepSize']}'"

    def unknowns(element, rows):
        lines = "".join(
            f"<Unknown index='{r}' dependencies='{' '.join(map(str, depends))}'/>"
            for r, depends in rows
        )
        return f"<{element}>{lines}</{element}>" if rows else ""

    structure = _structure(model, 2)
    items = "".join(f"<Item name='{p}' value='{i}'/>" for i, p in enumerate(PHASES))
    body = "\n".join(variables)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{token(name, 2)}"
 variableNamingConvention="structured">
<CoSimulation modelIdentifier="{name}"{_attributes(**flags)}/>
<UnitDefinitions>{_units()}</UnitDefinitions>
<TypeDefinitions>
<SimpleType name="Phase"><Enumeration>{items}</Enumeration></SimpleType>
</TypeDefinitions>
<LogCategories><Category name="logAll"/></LogCategories>
<DefaultExperiment startTime='0' {experiment}/>
<ModelVariables>
{body}
</ModelVariables>
<ModelStructure>{unknowns("Outputs", structure["outputs"])}
{unknowns("Derivatives", structure["derivatives"])}
{unknowns("InitialUnknowns", structure["initial"])}</ModelStructure>
</fmiModelDescription>
"""


def _xml3(name: str, model: Model) -> str:
    table = entries(model, 3)
    numbers = {e.name: i for i, e in enumerate(table)}
    clocks = [i for i, e in enumerate(table) if e.variable.type == "Clock"]
    variables = []
    for reference, entry in enumerate(table):
        v = entry.variable
        count = entry.count
        start = None
        inner = "".join(f"<Dimension start='{n}'/>" for n in v.shape)
        if v.start is not None:
            texts = [str(v.start).lower() if isinstance(v.start, bool) else str(v.start)] * count
            if v.type in ("String", "Binary"):
                inner += "".join(f"<Start value={quoteattr(text)}/>" for text in texts)
            else:
                start = " ".join(texts)
        common = {"causality": v.causality} if v.type == "Clock" else _common(v)
        is_clocked = bool(clocks) and v.causality == "output"
        outer = _attributes(
            name=v.name, valueReference=reference, **common,
            clocks=" ".join(map(str, clocks)) if is_clocked else None,
            declaredType="Phase" if v.type == "Enumeration" else None,
            unit=v.unit or None, min=v.min, max=v.max, start=start,
            derivative=numbers[v.derivative_of] if v.derivative_of else None,
        )  # fmt: skip
        if is_clocked:
            outer = outer.replace('"continuous"', '"discrete"')
        variables.append(f"<{v.type}{outer} {v.attributes}>{inner}</{v.type}>")

    def unknowns(element, rows):
        return "".join(
            f"<{element} valueReference='{r}' dependencies='{' '.join(map(str, depends))}'/>"
            for r, depends in rows
        )

    flags = model.capabilities
    if model.scheduled:
        flags = {k: value for k, value in flags.items() if k.startswith(("canGet", "canSer"))}
    flags = flags | _once(model)
    element = "ScheduledExecution" if model.scheduled else "CoSimulation"
    structure = _structure(model, 3)
    items = "".join(f"<Item name='{p}' value='{i}'/>" for i, p in enumerate(PHASES))
    body = "\n".join(variables)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{token(name, 3)}"
 variableNamingConvention="structured">
<{element} modelIdentifier="{name}"{_attributes(**flags)}/>
<UnitDefinitions>{_units()}</UnitDefinitions>
<TypeDefinitions><EnumerationType name="Phase">{items}</EnumerationType></TypeDefinitions>
<LogCategories><Category name="logAll"/></LogCategories>
<DefaultExperiment startTime='0' {model.experiment}/>
<ModelVariables>
{body}
</ModelVariables>
<ModelStructure>{unknowns("Output", structure["outputs"])}
{unknowns("ContinuousStateDerivative", structure["derivatives"])}
{unknowns("InitialUnknown", structure["initial"])}</ModelStructure>
</fmiModelDescription>
"""

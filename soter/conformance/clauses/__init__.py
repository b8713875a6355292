"""All clauses; importing this registers them, in the order in which they are judged."""

# The order is that of the reports.
# isort: off
from soter.conformance.clauses import lifecycle as lifecycle
from soter.conformance.clauses import capabilities as capabilities
from soter.conformance.clauses import state as state
from soter.conformance.clauses import samples as samples
from soter.conformance.clauses import charge as charge
from soter.conformance.clauses import goto as goto
from soter.conformance.clauses import speeds as speeds
from soter.conformance.clauses import goals as goals
from soter.conformance.clauses import authority as authority
from soter.conformance.clauses import programs as programs
from soter.conformance.clauses import deadman as deadman
from soter.conformance.clauses import leases as leases
from soter.conformance.clauses import clocks as clocks
from soter.conformance.clauses import several as several
from soter.conformance.clauses import crowd as crowd
from soter.conformance.clauses import bounds as bounds
from soter.conformance.clauses import legs as legs
from soter.conformance.clauses import ramps as ramps
from soter.conformance.clauses import contact as contact
from soter.conformance.clauses import asked as asked
from soter.conformance.clauses import endurance as endurance
from soter.conformance.clauses import pace as pace
from soter.conformance.clauses import anything as anything
from soter.conformance.clauses import link as link
from soter.conformance.clauses import returns as returns
from soter.conformance.clauses import disorder as disorder
from soter.conformance.clauses import outages as outages
from soter.conformance.clauses import process as process
from soter.conformance.clauses import resources as resources
from soter.conformance.clauses import host as host
from soter.conformance.clauses import quiet as quiet
from soter.conformance.clauses import surroundings as surroundings

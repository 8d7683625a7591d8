"""What the loop reports: streams to the network, documents to the recording, changes to the journal."""

import logging
from collections.abc import Mapping

from softarm.daemon.control.dependencies import MessageSink
from softarm.daemon.control.mismatch import MismatchTest
from softarm.daemon.control.publishing import Kind, Publisher, StateInputs
from softarm.daemon.control.streams import RecordedStreams, estimate_columns
from softarm.daemon.estimation.messages import EstimationResult
from softarm.daemon.safety.diagnostics import Diagnostic
from softarm.daemon.safety.modes import SERVICE, Transition, Trigger

logger = logging.getLogger(__name__)


class Reporter:
    """Reports what happens to the network, the recording and the journal.

    Args:
        arm: The arm's name.
        publisher: Builds the messages.
        sink: Publishes them.
        streams: Records them.
    """

    def __init__(self, arm: str, publisher: Publisher, sink: MessageSink, streams: RecordedStreams) -> None:
        self._arm = arm
        self._publisher = publisher
        self._sink = sink
        self._streams = streams

    @property
    def shape_wanted(self) -> bool:
        """Whether anybody listens to the shape, or a recording is due to get one."""
        return self._sink.shape_wanted or self._streams.shape_wanted

    def state(self, inputs: StateInputs, test: MismatchTest) -> None:
        """Publish the state of the arm and of the test of its model."""
        self._sink.publish("state", self._publisher.state(inputs))
        self._sink.publish("mismatch", self._publisher.mismatch(test, inputs.recording))

    def estimate(self, result: EstimationResult) -> None:
        """Publish and record an estimate."""
        estimate = self._publisher.estimate(result)
        self._sink.publish("estimate", estimate)  # before all that can wait
        if result.nodes is not None:
            self._sink.publish_shape(result.nodes.astype("<f4").tobytes())
        if self._streams.recording:
            sections, time_s = self._publisher.sections, result.request.time_s
            self._streams.estimated(estimate_columns(estimate, sections), time_s)
            if result.nodes is not None:
                self._streams.shaped(result.nodes, time_s)

    def transition(self, transition: Transition) -> None:
        """Report a change of mode and its client."""
        before, after, cause = transition.before, transition.after, transition.cause
        level = logging.WARNING if transition.trigger in (Trigger.FAULT, Trigger.LEASE_LOST) else logging.INFO
        logger.log(level, "%s -> %s: %s (asked for by %s)", before, after, cause, transition.by)
        by = transition.by
        self._streams.document("mode", {"before": before, "after": after, "cause": cause, "by": by})
        self._happened("mode", self._arm, f"{before} -> {after}: {cause}", by)

    def finding(self, finding: Diagnostic, new: bool) -> None:
        """Report a finding that is new or has cleared itself."""
        if new:
            level = logging.INFO if finding.severity == "info" else logging.WARNING
            logger.log(level, "%s: %s; %s", finding.where, finding.message, finding.hint)
        else:
            logger.info("%s: no longer: %s", finding.where, finding.message)
        self._happened("finding" if new else "finding_cleared", finding.where, finding.message)

    def contact(self, began: bool) -> None:
        """Report that a contact began or ended."""
        kind: Kind = "contact_begin" if began else "contact_end"
        words = "an external force acts" if began else "no external force acts any more"
        self._happened(kind, self._arm, words)

    def command(self, answer: Mapping[str, object]) -> None:
        """Record the answer to a command."""
        self._streams.document("command", answer)

    def _happened(self, kind: Kind, where: str, text: str, by: str = SERVICE) -> None:
        self._streams.document("event", {"kind": kind, "where": where, "text": text, "by": by})
        self._sink.publish("event", self._publisher.occurrence(kind, where, text, by))

import { firstUpper } from '../ui/format.js';
import { Icon } from '../ui/icon.js';
import type { Gate } from './job.js';

/** The quality checks of a rebuilt version: the verdict and each check. */
export function GateVerdict({ gate }: { gate: Gate }) {
  const passed = gate.verdict === 'pass';
  const checks = gate.checks ?? [];
  const failed = checks.filter((check) => !check.passed).length;
  const sorted = [...checks].sort((a, b) => Number(a.passed) - Number(b.passed));
  return (
    <section aria-labelledby="gate">
      <h2 id="gate">Checks</h2>
      <div class="card gate" data-verdict={gate.verdict}>
        <p class={passed ? 'verdict good' : 'verdict bad'}>
          <Icon name={passed ? 'check' : 'warning'} />
          {passed ? 'All checks passed.' : `${failed} of ${checks.length} checks failed.`}
        </p>
        <ul class="checks">
          {sorted.map((check) => (
            <li key={check.name} class={check.passed ? 'passed' : 'failed'}>
              <Icon name={check.passed ? 'check' : 'close'} />
              <span><span class="unseen">{check.passed ? 'Passed: ' : 'Failed: '}</span>{firstUpper(check.words)}</span>
            </li>
          ))}
        </ul>
        {(gate.warnings ?? []).map((warning) => <p key={warning} class="remark">{firstUpper(warning)}.</p>)}
      </div>
    </section>
  );
}

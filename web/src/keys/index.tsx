import { Empty } from '../ui/parts.js';
import type { ViewProps } from '../views.js';

export default function KeysView({ path }: ViewProps) {
  return <Empty title={path.join(' – ')}><p>Not built yet.</p></Empty>;
}
